"""Stations of scenes in which something moves: where it is, what fields know of it, and who touches it."""

import numpy as np
import pytest
import torch
from pydrake.systems.analysis import Simulator

from hotice.errors import InvalidConfig, InvalidScene, InvalidStation, NotAvailable
from hotice.fields.bank import FieldBank
from hotice.model import BoxShape, Obstacle, Scene
from hotice.model.geometry.shapes import SphereShape
from hotice.model.moving import Motion, WayPoint, walking_person
from hotice.policy import Percept
from hotice.policy.percept import NUM_SGF
from hotice.sim.moving import MovingObstacles
from hotice.systems import StationConfig, make_station
from hotice.systems.mujoco_plant import MujocoPlant
from hotice.systems.record.rollout import to_record
from hotice.systems.visualizer import ROOT, Visualizer
from hotice.task.moving import MovingConfig
from hotice.task.sensing import STUDENT_SENSING, SensingConfig

POST = Obstacle("post", "side", BoxShape((0.2, 0.2, 1.4)), (1.6, -0.9, 0.7))
BOUNDS = ((-0.5, -1.5, 0.0), (2.5, 1.5, 1.5))


@pytest.fixture(scope="module")
def crossing():
    """A person walks by ahead of the robot."""
    person = walking_person("ann", [(1.3, -1.2), (1.3, 1.2)], speed_m_s=1.0)
    return Scene("crossing", BOUNDS, obstacles=(*person[:1], POST, *person[1:]))


def thrown(at_s):
    """A ball comes at the chest, which it reaches after `at_s`."""
    ways = ((0.0, 2.2), (at_s, 0.3), (at_s + 0.5, 0.3))
    course = Motion(way_points=tuple(WayPoint(time_s=t, position_m=(x, 0.0, 1.0)) for t, x in ways))
    ball = Obstacle("ball", "side", SphereShape(0.1), (2.2, 0.0, 1.0), motion=course)
    return Scene("thrown", BOUNDS, obstacles=(POST, ball))


def at(simulator, station, system, port):
    part = station.GetSubsystemByName(system)
    return part.GetOutputPort(port).Eval(part.GetMyContextFromRoot(simulator.get_context()))


@pytest.mark.parametrize("exact", [True, False])
@pytest.mark.parametrize("known", ["near", "live"])
def test_fields_know_what_those_of_an_evaluation_know(crossing, known, exact):
    config = MovingConfig(known=known)
    station = make_station(
        StationConfig(scene=crossing, sensing=SensingConfig() if exact else STUDENT_SENSING, moving=config)
    )
    moving = MovingObstacles.of(FieldBank.build([crossing]), config, 3.0)
    simulator, index = Simulator(station), torch.tensor([0])
    for time_s in (0.0, 0.36, 0.94):
        simulator.AdvanceTo(time_s)
        reading = at(simulator, station, "guidance_field", "guidance")
        percept = Percept(at(simulator, station, "percept_guard", "percept"))
        world = moving.guiding(index, torch.tensor([time_s]), exact=exact)
        body = world.sample("sgf", index, torch.tensor(percept.p_WK[None, :NUM_SGF], dtype=torch.float32))
        carried = np.concatenate([percept.p_WK[NUM_SGF:], percept.p_WOK])
        load = world.sample(station.task.object_field, index, torch.tensor(carried[None], dtype=torch.float32))
        force = torch.cat([body.force_W[0], load.force_W[0]]).reshape(-1)
        distance = torch.cat([body.signed_distance[0], load.signed_distance[0]])
        np.testing.assert_allclose(reading[: len(force)], force, atol=5e-5)
        np.testing.assert_allclose(reading[len(force) : len(force) + len(distance)], distance, atol=5e-5)
        age_s = at(simulator, station, "guidance_field", "age")[0]
        assert np.isnan(age_s) if known == "near" else 0.0 <= age_s < 0.2 + (0.0 if exact else 0.1) + 1e-6
    # what is known matters: without it she is not there
    blind = make_station(StationConfig(scene=crossing, moving=MovingConfig(known="still")))
    still = Simulator(blind)
    still.AdvanceTo(0.94)
    assert np.abs(at(still, blind, "guidance_field", "guidance") - reading).max() > 0.05


def test_what_moves_is_where_it_will_be_after_each_step_and_a_run_repeats_itself(crossing):
    station = make_station(StationConfig(scene=crossing, moving=MovingConfig(known="live")))
    plant = station.GetSubsystemByName("plant")
    ends = []
    for _ in range(2):
        simulator = Simulator(station)
        simulator.AdvanceTo(0.5)
        middle = simulator.get_context().Clone()
        simulator.AdvanceTo(1.0)
        ends.append(at(simulator, station, "plant", "full_state").copy())
    np.testing.assert_array_equal(*ends)
    again = Simulator(station, middle)
    again.Initialize()
    again.AdvanceTo(1.0)
    np.testing.assert_array_equal(at(again, station, "plant", "full_state"), ends[0])
    her = [o.at(1.0) for o in crossing.moving]
    np.testing.assert_allclose(plant._data.mocap_pos, [o.position_m for o in her], atol=1e-9)
    np.testing.assert_allclose(plant._data.mocap_quat, [o.quaternion_wxyz for o in her], atol=1e-9)
    with pytest.raises(InvalidStation, match="0 obstacles move, the model has 2"):
        MujocoPlant(plant.model, station.start_qpos, np.zeros(20))


@pytest.mark.parametrize("controller", ["hold", "policy"])
def test_who_is_hit_is_told_and_whose_fault_it_was(controller):
    """A robot that stands is walked into; one on its way collides, with its load first."""
    config = StationConfig(scene=thrown(0.45), moving=MovingConfig(known="still"), log_hz=50.0)
    station = make_station(config, controller=controller)
    simulator, plant, hit_s = Simulator(station), station.GetSubsystemByName("plant"), None
    context = plant.GetMyContextFromRoot(simulator.get_context())
    for k in range(1, 31):
        simulator.AdvanceTo(0.02 * k)
        if hit_s is None and any(plant.hits(context)):
            hit_s = 0.02 * k
    record = to_record(station, simulator.get_context())
    assert hit_s is not None and 0.2 < hit_s <= 0.45
    assert record.outcome == {"hold": "walked_into", "policy": "object_collision"}[controller]
    touch = next(event for event in record.events if event.kind == "touch")
    assert touch.solids[1] == "ball" and abs(touch.time_s - hit_s) < 0.05


def test_where_nothing_moves_it_does_not_matter_what_would_be_known():
    ends = []
    for known in ("still", "live"):
        station = make_station(StationConfig(scene="gap", moving=MovingConfig(known=known)))
        simulator = Simulator(station)
        simulator.AdvanceTo(0.4)
        ends.append(at(simulator, station, "plant", "full_state").copy())
        assert "mover_poses" not in [system.get_name() for system in station.GetSystems()]
    np.testing.assert_array_equal(*ends)


def test_plants_and_controllers_that_know_no_movers_refuse_them(crossing, tmp_path):
    with pytest.raises(NotAvailable, match='plant="mujoco" alone'):
        make_station(StationConfig(scene=crossing), plant="drake")
    for controller in ("walk", "pickup", "pickup_then_policy"):
        with pytest.raises(InvalidScene, match=f"'{controller}' of a station does not know"):
            make_station(StationConfig(scene=crossing), controller=controller)
    (tmp_path / "station.yaml").write_text("moving: {known: live, ways_hz: 10}\n")
    assert StationConfig.load(tmp_path / "station.yaml").moving == MovingConfig(known="live", ways_hz=10.0)
    (tmp_path / "station.yaml").write_text("moving: live\n")
    assert StationConfig.load(tmp_path / "station.yaml").moving == MovingConfig(known="live")
    assert StationConfig(moving="still").moving == MovingConfig(known="still")
    for wrong in ("all", 3, None, {}):
        with pytest.raises(InvalidConfig, match="moving"):
            StationConfig(moving=wrong)
    (tmp_path / "station.yaml").write_text("moving: {known: all}\n")
    with pytest.raises(InvalidConfig, match="still, near, live"):
        StationConfig.load(tmp_path / "station.yaml")


def test_the_viewer_shows_her_where_she_is(crossing):
    class Board:
        def __init__(self):
            self.at = {}

        def SetTransform(self, path, pose, time_in_recording=None):
            self.at[path] = pose.translation()

        def __getattr__(self, name):
            return lambda *args, **options: None

    board = Board()
    station = make_station(StationConfig(scene=crossing, meshcat_hz=10.0), meshcat=board)
    assert isinstance(station.GetSubsystemByName("visualizer"), Visualizer)
    simulator = Simulator(station)
    simulator.AdvanceTo(0.5)
    for i, obstacle in enumerate(crossing.obstacles):
        np.testing.assert_allclose(board.at[f"{ROOT}/obstacles/{i}"], obstacle.at(0.5).position_m, atol=1e-9)
