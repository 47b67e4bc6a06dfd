"""From pick-up to policy: who takes over, why, and what is told of it."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

pytest.importorskip("pinocchio")

from hotice.control.pickup.footwork import Departure
from hotice.errors import InvalidConfig, InvalidStation, NotAvailable
from hotice.fields import build_hod_pf
from hotice.model import Obstacle, Scene
from hotice.model.carry import solve_carry
from hotice.model.geometry.shapes import BoxShape
from hotice.model.robot_state import RobotState
from hotice.policy import PolicyTask
from hotice.systems import StationConfig, make_station, read_logs
from hotice.systems.hand_over.mode_selector import CARRY, HOLD, WALK, HandOver, ModeSelector
from hotice.systems.hand_over.rehearsal import Rehearsal
from hotice.systems.hand_over.stage import VERDICTS
from hotice.systems.hand_over.walk_rehearsal import WalkRehearsal
from hotice.systems.logs import SignalLog
from hotice.systems.record.hand_over import HandOverReport, report_hand_over
from hotice.systems.record.picture import wires
from hotice.systems.setup.departure import SECTOR_RAD, plan_departure
from hotice.systems.setup.rehearsal_config import RehearsalConfig
from hotice.systems.setup.setup import StationSetup
from hotice.systems.setup.table import SUPPORT, around_table, beside_start, table_of, with_table

OPEN = Scene("open")


@pytest.mark.parametrize(
    "verdict, of_walk, mode, torque",
    [(0, 0, CARRY, 5.0), (0, 1, CARRY, 5.0), (1, 0, WALK, -3.0), (2, 1, HOLD, 1.0), (1, None, WALK, -3.0)],
)
def test_the_verdicts_choose_who_takes_over(verdict, of_walk, mode, torque, robot_state):
    """The policy if it is fit, else the walk if that is, else no one: the pick-up goes on holding."""
    seen, walks = [], []

    def rehearse(state):
        seen.append(state.copy())
        return verdict

    def rehearse_walk(state):
        walks.append(state.copy())
        return of_walk

    rule = HandOver(ready_phase=8, settle_s=0.1, blend_s=0.2)
    system = ModeSelector(rule, 0.02, rehearse, None if of_walk is None else rehearse_walk)
    simulator = Simulator(system)
    context = simulator.get_mutable_context()
    held = np.array([0.0, 0, 180, 0, 0, 180, 0, 40, 0, 0, -40, 0])
    torques = {"pickup_torque": 1.0, "carry_torque": 5.0, "walk_torque": -3.0}
    for name, value in torques.items():
        system.GetInputPort(name).FixValue(context, np.full(20, value))
    for name, value in (("phase", [8.0]), ("contact_force", held), ("robot_state", robot_state)):
        system.GetInputPort(name).FixValue(context, value)

    def outputs(*names):
        return [float(system.GetOutputPort(name).Eval(context)[0]) for name in names]

    simulator.AdvanceTo(0.09)
    assert outputs("mode", "verdict", "walk_verdict", "fallbacks") == [0.0, -1.0, -1.0, 0.0] and not seen
    simulator.AdvanceTo(1.0)
    assert len(seen) == 1 and (seen[0] == robot_state).all()  # one rehearsal, from the state at the switch
    tried = verdict > 0 and of_walk is not None
    assert len(walks) == tried and all((state == robot_state).all() for state in walks)
    assert outputs("mode", "verdict", "walk_verdict") == [mode, verdict, of_walk if tried else -1.0]
    walking = float(mode == WALK)
    assert outputs("carry_active", "walk_active", "fallbacks") == [float(mode == CARRY), walking, walking]
    assert outputs("torque") == [torque]


@pytest.fixture(scope="module")
def ready():
    """A station with policy `student` and its carry state at the start, (84,)."""
    station = make_station(StationConfig(physics_dt_s=0.005, servo="pd"))
    qpos, qvel = RobotState.from_carry(station.carry).to_mujoco(29)
    return station, np.concatenate([qpos, qvel])


def test_a_rehearsal_knows_fit_from_unfit(ready):
    """From its own carry state the policy goes on; thrown over, or with the object out of reach, it does not."""
    station, state = ready
    once = Rehearsal(station.setup, RehearsalConfig(horizon_s=2.0, push_m_s=(0.0,)))
    before = state.copy()
    assert VERDICTS[once(state)] == "fit" and VERDICTS[once(state)] == "fit"
    np.testing.assert_array_equal(state, before)
    thrown, lost = state.copy(), state.copy()
    thrown[43:46] += [0.0, 4.0, 0.0]
    lost[36] += 0.5
    assert VERDICTS[once(thrown)] == "fall" and VERDICTS[once(lost)] == "drop"
    pushed = Rehearsal(station.setup, RehearsalConfig(horizon_s=2.0, push_m_s=(0.0, 4.0)))
    assert VERDICTS[pushed(state)] in ("fall", "drop")  # the second try counts too


def test_a_rehearsal_of_the_walk(ready):
    """From standing with the object it is fit; thrown over, with the object out of reach, or walled in, it is not."""
    station, state = ready
    walk = WalkRehearsal(station.setup, RehearsalConfig(horizon_s=1.5, push_m_s=(0.0,)))
    before = state.copy()
    assert VERDICTS[walk(state)] == "fit" and VERDICTS[walk(state)] == "fit"
    np.testing.assert_array_equal(state, before)
    thrown, lost, away = state.copy(), state.copy(), state.copy()
    thrown[43:46] += [0.0, 4.0, 0.0]
    lost[36] += 0.5
    assert VERDICTS[walk(thrown)] == "fall" and VERDICTS[walk(lost)] == "drop"
    pushed = WalkRehearsal(station.setup, RehearsalConfig(horizon_s=1.5, push_m_s=(0.0, 4.0)))
    assert VERDICTS[pushed(state)] in ("fall", "drop")
    moat = Obstacle("moat", "ground", BoxShape((1.2, 2.0, 0.1)), (1.1, 0.0, 0.05))
    cut_off = StationSetup.decide(StationConfig(scene=Scene("moat", obstacles=(moat,)), physics_dt_s=0.005, servo="pd"))
    away[[0, 36]] -= 0.1
    assert VERDICTS[WalkRehearsal(cut_off)(away)] == "no_way"


def test_a_rehearsal_of_the_walk_sees_obstacles_and_motors(ready):
    station, state = ready
    here = state.copy()
    post = Obstacle("post", "side", BoxShape((0.1, 0.1, 1.4)), (0.25, 0.0, 0.7))
    scene = Scene("post", bounds_m=((-1.0, -1.5, 0.0), (2.5, 1.5, 1.5)), obstacles=(post,), start=(-0.6, 0.0, 0.0))
    blocked = StationSetup.decide(StationConfig(scene=scene, physics_dt_s=0.005, servo="pd"))
    verdict = WalkRehearsal(blocked, RehearsalConfig(horizon_s=0.2, push_m_s=(0.0,)))(here)
    assert VERDICTS[verdict] in ("object_collision", "robot_collision")
    weak = WalkRehearsal(station.setup, RehearsalConfig(horizon_s=1.0, push_m_s=(0.0,)))
    weak.stage.model.actuator_forcerange[:] *= 0.3
    assert VERDICTS[weak(state)] in ("fall", "drop")


def test_a_rehearsal_sees_obstacles(ready):
    station, state = ready
    wall = Obstacle("post", "side", BoxShape((0.1, 0.1, 1.4)), (0.1, 0.1, 0.7))
    scene = Scene("post", obstacles=(wall,), start=(-0.4, 0.0, 0.0))
    blocked = StationSetup.decide(StationConfig(scene=scene, physics_dt_s=0.005, servo="pd"))
    here = state.copy()
    here[[0, 36]] -= 0.1  # the post is in the box
    verdict = Rehearsal(blocked, RehearsalConfig(horizon_s=0.2, push_m_s=(0.0,)))(here)
    assert VERDICTS[verdict] in ("object_collision", "robot_collision")


def test_a_rehearsal_senses_as_the_station_does(ready):
    """The measurements of a rehearsal are as far off the truth as the station's noise allows, each try's its own."""
    from hotice.policy.percept import PerceptModel
    from hotice.systems.hand_over.rehearsal import Sensing

    station, state = ready
    model = PerceptModel(station.carry.carried)
    true, keypoints = model(state[:43], state[43:]), model.keypoints_at(state[:43])
    assert Sensing(station.setup, 0)(true, keypoints) is true
    noisy = StationSetup.decide(StationConfig.from_dict({"sensing": "student"}))
    a, b, again = (Sensing(noisy, number)(true, keypoints) for number in (0, 1, 0))
    np.testing.assert_array_equal(a.vector, again.vector)
    half = noisy.config.sensing
    assert (
        0 < np.abs(a.q - true.q).max() <= half.joint_pos_rad
        and 0 < np.abs(a.qd - true.qd).max() <= half.joint_vel_rad_s
    )
    assert (a.q != b.q).all() and 0 < np.abs(a.p_WK - true.p_WK).max() < 0.15


@pytest.mark.parametrize(
    "values, message",
    [
        ({"horizon_s": -1.0}, "horizon_s"),
        ({"horizon_s": "long"}, "horizon_s"),
        ({"push_m_s": ()}, "push_m_s"),
        ({"push_m_s": (float("nan"),)}, "push_m_s"),
        ({"push_m_s": "no"}, "push_m_s"),
    ],
)
def test_impossible_rehearsals(values, message):
    with pytest.raises(InvalidConfig, match=message):
        RehearsalConfig(**values)
    with pytest.raises(InvalidConfig, match=message):
        StationConfig.from_dict({"rehearsal": values})


def test_a_rehearsal_from_a_file():
    config = StationConfig.from_dict({"rehearsal": {"horizon_s": 2, "push_m_s": [0, 0.2]}})
    assert config.rehearsal == RehearsalConfig(horizon_s=2, push_m_s=(0.0, 0.2))
    with pytest.raises(InvalidConfig, match="unknown key 'depth'"):
        StationConfig.from_dict({"rehearsal": {"depth": 2}})


@pytest.mark.parametrize("bearing", [np.pi / 2, -np.pi / 2, 0.0])
def test_departures_leave_room_and_turn_to_the_command(bearing):
    config = StationConfig(pick_bearing_rad=bearing)
    world = with_table(OPEN, table_of(OPEN, config))
    pf, origin = build_hod_pf(around_table(world)), (0.0, 0.0, bearing)
    carry = solve_carry(config.carried)
    found = plan_departure(pf, PolicyTask(), carry, origin)
    assert found.back_m >= 0.2
    if bearing:
        assert np.sign(found.turn_rad) == -np.sign(bearing)
        assert abs(found.turn_rad) == pytest.approx(np.pi / 2 - SECTOR_RAD, abs=0.35)
    behind = Obstacle("wall", "side", BoxShape((0.1, 3.0, 1.5)), (-0.65, 0.0, 0.75))
    if bearing == 0.0:  # no room to step back as far
        tight = around_table(
            with_table(
                Scene("tight", ((-1.0, -1.0, 0.0), (2.5, 1.0, 1.5)), obstacles=(behind,)), table_of(OPEN, config)
            )
        )
        assert plan_departure(build_hod_pf(tight), PolicyTask(), carry, origin).back_m < found.back_m


def test_fields_lead_around_the_table():
    config = StationConfig(pick_bearing_rad=0.0)
    world = with_table(OPEN, table_of(OPEN, config))
    top = np.array([0.45, 0.0, 0.75])
    assert build_hod_pf(world).sgf.signed_distance(top) > 0.1  # a pelvis could fly over it
    pf = build_hod_pf(around_table(world))
    assert pf.sgf.signed_distance(top) < 0.0
    force = pf.sgf.sample(np.array([-0.4, 0.0, 0.75]))
    assert abs(np.arctan2(force[1], force[0])) > 0.4
    assert [o.name for o in world.obstacles] == [SUPPORT] and world.obstacles[0].shape.size_m[
        2
    ] == config.support_height_m


def test_a_table_beside_the_start():
    config = StationConfig()
    assert beside_start(OPEN, config).pick_bearing_rad == pytest.approx(np.pi / 2)
    left = Obstacle("post", "side", BoxShape((0.1, 0.1, 1.2)), (0.3, 0.62, 0.6))
    assert beside_start(Scene("left", obstacles=(left,)), config).pick_bearing_rad == pytest.approx(-np.pi / 2)
    walls = [
        Obstacle(f"w{i}", "side", BoxShape((0.3, 0.3, 1.4)), (0.65 * np.cos(a), 0.65 * np.sin(a), 0.7))
        for i, a in enumerate(np.linspace(0.6, 5.7, 9))
    ]
    with pytest.raises(InvalidStation, match="no room for a table"):
        beside_start(Scene("cell", obstacles=tuple(walls)), config)


def logs_of(station, modes, verdict, of_walk=-1.0, **change):
    """Logs of a station that stands in its carry state; `of_walk`: the walk's verdict. `change`: last row's columns."""
    qpos, qvel = RobotState.from_carry(station.carry).to_mujoco(29)
    rows = np.tile(np.concatenate([qpos, qvel]), (len(modes), 1))
    for index, value in change.items():
        rows[-1, int(index[1:])] = value
    time = 0.1 * np.arange(len(modes))
    signals = {"mode_selector.mode": modes, "mode_selector.verdict": verdict, "pickup.phase": [2.0] * len(modes)}
    signals["mode_selector.walk_verdict"] = [of_walk] * len(modes)
    logs = {k: SignalLog(time_s=time, value=np.array(v, dtype=float)[:, None]) for k, v in signals.items()}
    return logs | {"state_adaptor.robot_state": SignalLog(time_s=time, value=rows)}


def test_what_is_told_of_a_hand_over(ready):
    station, _ = ready
    report = report_hand_over(station, logs_of(station, [0, 0, 1, 1], [-1, -1, 0, 0]))
    assert report == HandOverReport(who="policy", time_s=pytest.approx(0.2), verdict="fit", failure="")
    report = report_hand_over(station, logs_of(station, [0, 2, 2], [-1, 1, 1]))
    assert report.fell_back and "handed over to the walk (policy rehearsal: fall)" in str(report)
    report = report_hand_over(station, logs_of(station, [0, 3, 3], [-1, 1, 1], of_walk=3.0))
    assert report.held and not report.fell_back and not report.failure and report.walk_verdict == "robot_collision"
    assert "keeps holding (policy rehearsal: fall; walk: robot collision)" in str(report)
    report = report_hand_over(station, logs_of(station, [0, 3, 3], [-1, 1, 1], of_walk=6.0))
    assert "walk: no path" in str(report)
    report = report_hand_over(station, logs_of(station, [0, 1, 1], [-1, 0, 0], _2=0.3))
    assert (report.failure, report.failed_s) == ("fall", pytest.approx(0.1))
    assert report_hand_over(station, logs_of(station, [0, 1, 1], [-1, 0, 0], _38=1.4)).failure == "drop"
    report = report_hand_over(station, logs_of(station, [0, 0], [-1, -1]))
    assert report.time_s is None and "ended in phase reach" in report.failure
    with pytest.raises(NotAvailable, match="hands nothing over"):
        report_hand_over(station, {})


@pytest.mark.slow
@pytest.mark.parametrize("policy", ["student", "carry"])
def test_the_box_stays_in_the_hands(policy):
    """Three seconds beyond the switch, whoever carries on; `student`, which is fit for it, does so itself. No jump in
    torque."""
    from benchmarks.handover import advance_beyond

    station = make_station(StationConfig(policy=policy, log_hz=50.0), controller="pickup_then_policy")
    simulator = Simulator(station)
    advance_beyond(station, simulator, 3.0)
    logs = read_logs(station, simulator.get_context())
    report = report_hand_over(station, logs)
    assert report.time_s is not None and not report.failure
    assert report.who == "policy" or policy == "carry"
    switch = int(np.argmax(logs["mode_selector.mode"].value[:, 0] > 0))
    torque = logs["safety_monitor.command"].value
    assert np.abs(torque[switch + 1] - torque[switch]).max() < 30.0
    force = logs["plant.contact_force"].value.reshape(-1, 4, 3)[switch - 10 : switch + 25, 2:]
    assert np.linalg.norm(force, axis=2).min() > 3.0


@pytest.mark.slow
def test_without_skill_the_walk_carries_on(monkeypatch):
    """Where the rehearsal always ends in a fall, the baseline takes the box from the pick-up and walks on with it."""
    from hotice.systems.record.play import play_station

    monkeypatch.setattr(Rehearsal, "__call__", lambda self, state: VERDICTS.index("fall"))
    station = make_station(StationConfig(log_hz=25.0), controller="pickup_then_policy")
    assert ("walk", "torque", "mode_selector", "walk_torque") in wires(station)
    found = play_station(station, 4.0)
    assert found.hand_over is not None and found.hand_over.fell_back and not found.hand_over.failure
    start, end = found.record.root_pos_W[[0, -1], 0]
    assert end > start + 0.3 and found.record.policy == "pickup_then_policy: walk"


@pytest.mark.slow
def test_where_neither_is_fit_the_box_is_held(monkeypatch):
    """The pick-up goes on holding, and the report says why; policy and walk never command."""
    from hotice.systems.record.play import play_station

    monkeypatch.setattr(Rehearsal, "__call__", lambda self, state: VERDICTS.index("fall"))
    monkeypatch.setattr(WalkRehearsal, "__call__", lambda self, state: VERDICTS.index("drop"))
    found = play_station(make_station(StationConfig(log_hz=25.0), controller="pickup_then_policy"), 2.0)
    assert found.hand_over is not None and found.hand_over.held and not found.hand_over.failure
    assert found.record.policy == "pickup_then_policy: hold"
    x = found.record.root_pos_W[found.record.time_s > found.hand_over.time_s]
    assert len(x) > 20 and np.abs(x[-1] - x[0]).max() < 0.03


def test_departures_of_stations(monkeypatch):
    """Only a pick-up that hands over departs, and it is asked to where the policy is to go."""
    import hotice.systems.setup.departure as departure

    monkeypatch.setattr(departure, "plan_departure", lambda *_: Departure(back_m=0.3, turn_rad=-0.4))
    alone = make_station(controller="pickup")
    assert alone.pick.controller.departure == Departure()
    both = make_station(controller="pickup_then_policy")
    assert both.pick.controller.departure == Departure(back_m=0.3, turn_rad=-0.4)
    assert both.carry is both.pick.carry and (both.carry.wrist_pos == both.pick.controller.planner.wrist_pos).all()
