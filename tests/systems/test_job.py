"""The whole job: the support at the goal, who gives back when, the referee, and one run to its end."""

from dataclasses import replace

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

pytest.importorskip("pinocchio")
pytest.importorskip("proxsuite")

from hotice.errors import InvalidConfig, InvalidStation, PickInfeasible, PutDownInfeasible
from hotice.fields import build_hod_pf
from hotice.model import Box, Obstacle, load_scene
from hotice.model.geometry.shapes import BoxShape
from hotice.systems import StationConfig, make_station
from hotice.systems.hand_over.mode_selector import CARRY, PUTDOWN, HandOver, ModeSelector
from hotice.systems.job.referee import JobReferee
from hotice.systems.job.run import OUTCOMES, run_job
from hotice.systems.setup.put import GOAL_SUPPORT, before_goal, goal_support, plan_put
from hotice.systems.setup.rehearsal_config import RehearsalConfig
from hotice.systems.setup.table import beside_start, with_table

BOX = Box((0.28, 0.28, 0.28), 1.5)
HELD = np.array([0.0, 0, 180, 0, 0, 180, 0, 40, 0, 0, -40, 0])


def config(scene, **change):
    given = dict(scene=scene, carried=BOX, support_height_m=0.55, support_near_m=0.24, put_near_m=0.24)
    made = StationConfig(**given | {"put_height_m": 0.55, "rehearsal": RehearsalConfig(horizon_s=0.0)} | change)
    return before_goal(made.scene, beside_start(made.scene, made))


@pytest.fixture(scope="module")
def station():
    return make_station(config(load_scene("open_floor")), controller="job")


@pytest.mark.parametrize("name", ["open_floor", "gap", "beam"])
def test_the_support_disturbs_the_fields_no_more_than_its_geometry(name):
    """Where the robot goes, up to the goal, geodesics are those of the scene; forces differ within reach of the support
    alone."""
    scene = load_scene(name)
    made = config(scene)
    plain, support = build_hod_pf(scene), goal_support(scene, made)
    both = build_hod_pf(with_table(scene, support))
    x, y = np.meshgrid(np.linspace(0.0, 1.9, 20), np.linspace(-0.4, 0.4, 9))
    p = np.stack([x.ravel(), y.ravel(), np.full(x.size, 0.75)], axis=1)
    free = plain.sgf.signed_distance(p) > 0.1
    a, b = (pf.sgf.geodesic_distance(p[free]) for pf in (plain, both))
    np.testing.assert_allclose(a, b, atol=0.03)
    far = support.signed_distance(p[free]) > plain.params.influence_distance_m + 0.05
    a, b = (pf.sgf.sample(p[free][far]) for pf in (plain, both))
    assert far.sum() > 50
    cosine = (a * b).sum(axis=1) / (np.linalg.norm(a, axis=1) * np.linalg.norm(b, axis=1))
    assert np.quantile(cosine, 0.05) > 0.95


def test_a_support_stands_where_there_is_room():
    open_scene = replace(load_scene("open_floor"), obstacles=())
    assert config(open_scene).put_bearing_rad == 0.0
    x, y = open_scene.goal[:2]
    wall = Obstacle("wall", "side", BoxShape((0.2, 0.6, 1.0)), (x + 0.9, y, 0.5))
    turned = config(replace(open_scene, obstacles=(wall,)))
    assert turned.put_bearing_rad != 0.0
    ring = [
        Obstacle(f"wall{i}", "side", BoxShape((0.2, 0.6, 1.0)), (x + 0.7 * np.cos(t), y + 0.7 * np.sin(t), 0.5))
        for i, t in enumerate(np.linspace(-2.0, 2.0, 7))
    ]
    with pytest.raises(InvalidStation, match="no room for a support at its goal: set put_bearing_rad"):
        config(replace(open_scene, obstacles=tuple(ring)))


@pytest.mark.parametrize(
    "change, error, match",
    [
        ({"put_height_m": 1.2}, PickInfeasible, "1.20 m: allowed are 0.40 to 0.85"),
        ({"put_near_m": 0.6, "carried": Box((0.4, 0.2, 0.2), 1.0)}, PutDownInfeasible, "cannot be put.*near_m"),
    ],
)
def test_supports_out_of_reach_are_refused(change, error, match):
    scene = load_scene("open_floor")
    with pytest.raises(error, match=match):
        plan_put(replace(config(scene), **change), scene, 0.05)


@pytest.mark.parametrize(
    "change", [{"put_ahead_m": -0.1}, {"put_height_m": 0.0}, {"put_near_m": np.nan}, {"put_bearing_rad": 9.0}]
)
def test_numbers_that_cannot_be_are_refused(change):
    with pytest.raises(InvalidConfig, match=next(iter(change))):
        StationConfig(**change)


def test_who_carries_gives_back_on_arrival(robot_state):
    """Not before the goal, not without the object in both hands, not in a fault; torques go over in time."""
    there = [False]
    system = ModeSelector(HandOver(ready_phase=8, settle_s=0.0), 0.02, arrived=lambda state, force: there[0])
    simulator = Simulator(system)
    context = simulator.get_mutable_context()
    for name, value in {"pickup_torque": 1.0, "carry_torque": 5.0, "putdown_torque": -3.0}.items():
        system.GetInputPort(name).FixValue(context, np.full(20, value))
    force = system.GetInputPort("contact_force").FixValue(context, HELD)
    answer = system.GetInputPort("answer").FixValue(context, np.zeros(2))
    for name, value in (("phase", [8.0]), ("robot_state", robot_state)):
        system.GetInputPort(name).FixValue(context, value)

    def now(name):
        return system.GetOutputPort(name).Eval(context)[0]

    simulator.AdvanceTo(0.5)
    assert (now("mode"), now("torque"), now("pickup_active"), now("putdown_active")) == (CARRY, 5.0, 1.0, 0.0)
    there[0] = True
    force.GetMutableData().set_value(0.1 * HELD)
    simulator.AdvanceTo(0.6)
    assert now("mode") == CARRY
    force.GetMutableData().set_value(HELD)
    answer.GetMutableData().set_value([1.0, 4.0])
    simulator.AdvanceTo(0.7)
    assert now("mode") == CARRY
    answer.GetMutableData().set_value(np.zeros(2))
    simulator.AdvanceTo(0.73)
    assert now("mode") == PUTDOWN and -3.0 < now("torque") < 5.0
    simulator.AdvanceTo(0.9)
    assert (now("torque"), now("pickup_active"), now("carry_active"), now("putdown_active")) == (-3.0, 0.0, 0.0, 1.0)


def test_the_referee_knows_what_may_touch_what(station):
    """The object on its first support: free until it is carried; at its place with the hands off: put down."""
    referee, q = JobReferee(station), station.start_qpos.astype(float)
    still = np.zeros(32)
    q[29] -= 0.001
    assert referee.failure("pickup", q, still) == ""
    assert not referee.lifted
    assert referee.failure("carry", q, still) == "drop"
    up = q.copy()
    up[29] += 0.03
    assert referee.failure("pickup", up, still) == "" and referee.lifted
    placed = q.copy()
    placed[27:30] = station.put.p_WO - [0.0, 0.0, 0.001]
    assert referee.failure("putdown", placed, still) == "" and referee.placed()
    assert referee.away_m < 0.002 and referee.apart_m > 0.1
    assert referee.failure("pickup", placed, still) == "object_collision"
    assert referee.touched == f"object at {GOAL_SUPPORT}"
    placed[27] += 0.06
    assert referee.failure("putdown", placed, still) == "" and not referee.placed()
    fallen = q.copy()
    fallen[2] = 0.2
    assert referee.failure("pickup", fallen, still) == "fall"
    inside = q.copy()
    inside[0:2] = station.put.p_WO[:2]
    assert referee.failure("carry", inside, still) in ("drop", "robot_collision")
    assert referee.failure("putdown", inside, still) == "robot_collision"


def test_a_job_that_never_begins_to_carry_is_not_lifted(station, monkeypatch):
    from hotice.systems.job import run

    monkeypatch.setitem(run.LIMIT_S, "pickup", 0.3)
    result = run_job(station)
    assert result.outcome == "not_lifted" and result.why == "time is over in pickup"
    assert result.seconds == {"pickup": pytest.approx(0.3)} and np.isnan(result.away_m)
    assert set(OUTCOMES) >= {"success", "put_down_wrong", "not_handed_over"}


@pytest.mark.slow
def test_a_whole_job(station):
    """Picked up, carried by the student without a rehearsal, put down; exact sensing and robot."""
    result = run_job(station)
    assert result.outcome == "success", result
    assert list(result.seconds) == ["pickup", "carry", "putdown"] and result.away_m < 0.05
