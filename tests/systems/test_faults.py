"""Each fault injected into a walking station is named, counted and answered; where it falls, it is damped in time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from hotice.errors import InvalidStation
from hotice.model import g1
from hotice.safety import Answer, Fault
from hotice.systems import InjectedFault, StationConfig, lost_box, make_station
from hotice.systems.faulty import BOX, FaultySignal
from hotice.systems.signals import JOINT_POS, JOINT_VEL

AT_S = 0.6
"""When it happens: the robot walks."""
ONE = (int(JOINT_POS[3]),)
SPEED = (int(JOINT_VEL[3]),)
QUAT = (3, 4, 5, 6)


def one(signal, index=None, **more):
    return (InjectedFault(signal=signal, index=index, from_s=AT_S, **more),)


def state(kind, **more):
    """Of numbers and tick alike."""
    return one("robot_state", kind=kind, **more) + one("tick", kind=kind, **more)


@dataclass(frozen=True)
class Seen:
    """Time since the cause of each check, answer and fault then; heights, lean and joint speeds; counts."""

    time_s: np.ndarray
    answer: list[Answer]
    fault: list[Fault]
    state: np.ndarray
    counts: dict[Fault, int]

    @property
    def up(self):
        return 1.0 - 2.0 * (self.state[:, 4] ** 2 + self.state[:, 5] ** 2)

    @property
    def speed(self):
        return np.abs(self.state[:, JOINT_VEL]).max(axis=1)

    def damped_s(self):
        """Time from the cause to damping [s], inf: never."""
        return min((t for t, a in zip(self.time_s, self.answer, strict=True) if a is Answer.DAMP), default=np.inf)


def watch(station, seconds=3.0, at_s=AT_S, simulator=None):
    simulator = simulator or Simulator(station)
    monitor, adaptor = (station.GetSubsystemByName(name) for name in ("safety_monitor", "state_adaptor"))
    root, rows = simulator.get_context(), []
    of_monitor, of_adaptor = monitor.GetMyContextFromRoot(root), adaptor.GetMyContextFromRoot(root)
    for k in range(round(seconds / 0.02)):
        simulator.AdvanceTo(0.02 * k + 0.001)
        answer, fault = monitor.GetOutputPort("answer").Eval(of_monitor)
        measured = adaptor.GetOutputPort("robot_state").Eval(of_adaptor).copy()
        rows.append((0.02 * k - at_s, Answer(int(answer)), Fault(int(fault)), measured))
    time_s, answers, faults, states = zip(*rows, strict=True)
    counts = monitor.GetOutputPort("faults").Eval(of_monitor)
    return Seen(
        np.array(time_s),
        list(answers),
        list(faults),
        np.array(states),
        {Fault(i): int(n) for i, n in enumerate(counts) if i and n},
    )


def faulty(faults, **config):
    return watch(make_station(StationConfig(scene="open_floor", **config), faults=faults))


def quiet_before(seen):
    rows = zip(seen.time_s, seen.answer, seen.fault, strict=True)
    assert all(a is Answer.PASS and f is Fault.NONE for t, a, f in rows if t < -1e-6)


def damped_in_time(seen):
    """Damping within 100 ms, and joints that were at most as fast 40 to 140 ms after it as until then."""
    when = seen.damped_s()
    assert 0.0 <= when <= 0.1
    peak = seen.speed[(seen.time_s >= -0.2) & (seen.time_s <= when + 0.021)].max()
    assert seen.speed[(seen.time_s >= when + 0.04) & (seen.time_s <= when + 0.14)].max() < peak
    assert all(a is Answer.DAMP for t, a in zip(seen.time_s, seen.answer, strict=True) if t >= when)


DAMPED = {
    "NaN joint": (one("robot_state", ONE), Fault.STATE_NOT_FINITE),
    "infinite joint": (one("robot_state", ONE, value=np.inf), Fault.STATE_NOT_FINITE),
    "NaN gyro": (one("robot_state", (46, 47, 48)), Fault.STATE_NOT_FINITE),
    "NaN quaternion": (one("robot_state", QUAT), Fault.STATE_NOT_FINITE),
    "zero quaternion": (one("robot_state", QUAT, value=0.0), Fault.QUATERNION),
    "quaternion of length 3": (one("robot_state", QUAT, kind="scale", value=3.0), Fault.QUATERNION),
    "quaternion of length 1e-3": (one("robot_state", QUAT, kind="scale", value=1e-3), Fault.QUATERNION),
    "speed of 1e6": (one("robot_state", SPEED, value=1e6), Fault.STATE_IMPOSSIBLE),
    "encoder off by 3 rad": (one("robot_state", ONE, kind="add", value=3.0), Fault.STATE_IMPOSSIBLE),
    "all NaN": (one("robot_state"), Fault.STATE_NOT_FINITE),
    "NaN percept": (one("percept"), Fault.OBSERVATION_INVALID),
    "NaN gravity in the percept": (one("percept", (4, 5, 6)), Fault.OBSERVATION_INVALID),
    "NaN command": (one("command"), Fault.COMMAND_NOT_FINITE),
    "infinite command": (one("command", (4,), value=np.inf), Fault.COMMAND_NOT_FINITE),
    "targets of 1e9 rad": (one("command", value=1e9), Fault.COMMAND_RANGE),
    "frozen": (state("frozen"), Fault.STATE_FROZEN),
    "frozen numbers under a running tick": (one("robot_state", kind="frozen"), Fault.STATE_FROZEN),
    "frozen tick": (one("tick", kind="frozen"), Fault.STATE_FROZEN),
    "60 ms late": (state("late", value=0.06), Fault.STATE_LATE),
    "missing": (one("tick"), Fault.STATE_MISSING),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", DAMPED)
def test_what_cannot_go_on_is_damped_within_100_ms(name):
    faults, fault = DAMPED[name]
    seen = faulty(faults)
    quiet_before(seen)
    assert seen.counts[fault] >= 100
    first = next(t for t, f in zip(seen.time_s, seen.fault, strict=True) if f)
    assert first <= 0.021, "found at the first sample, or where it stands still at the second"
    damped_in_time(seen)


STOPPED = {
    "NaN box pose": (one("percept", BOX), Fault.BOX_INVALID, 0.5),
    "box 3 m away": (one("percept", BOX[:3], kind="add", value=3.0), Fault.BOX_INVALID, 0.5),
    "lost box": (lost_box(AT_S), Fault.BOX_LATE, 0.5),
    "NaN pelvis pose": (one("percept", (0, 1, 2)), Fault.POSE_INVALID, 0.3),
    "pelvis under the floor": (one("percept", (2,), value=-0.3), Fault.POSE_INVALID, 0.3),
    "pelvis under the floor, by its own state": (one("robot_state", (2,), value=-0.3), Fault.POSE_INVALID, 0.3),
    "NaN guidance": (one("guidance"), Fault.GUIDANCE_INVALID, 0.0),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", STOPPED)
def test_what_is_not_known_of_the_way_makes_it_stand_upright(name):
    faults, fault, stop_s = STOPPED[name]
    seen = faulty(faults)
    quiet_before(seen)
    assert seen.counts[fault] >= 100
    stopped = [a is Answer.STOP_WALKING for t, a in zip(seen.time_s, seen.answer, strict=True) if t > stop_s + 0.1]
    assert all(stopped) and len(stopped) > 50
    assert all(a is Answer.PASS for t, a in zip(seen.time_s, seen.answer, strict=True) if t < stop_s - 0.021)
    assert seen.up.min() > 0.9 and seen.state[:, 2].min() > 0.65
    place = seen.state[seen.time_s > stop_s][0, :2]
    assert np.linalg.norm(seen.state[seen.time_s > stop_s][:, :2] - place, axis=1).max() < 0.3


@pytest.mark.slow
@pytest.mark.parametrize("servo", ["motor", "pd"])
@pytest.mark.parametrize("plant", ["mujoco", "drake"])
@pytest.mark.parametrize("name", ["NaN joint", "speed of 1e6", "NaN command", "targets of 1e9 rad", "frozen"])
def test_in_either_plant_with_either_servo_joints_slow_down(name, plant, servo):
    """Of Drake's servo the commands are torques, of up to 1e9 N m."""
    faults, fault = DAMPED[name]
    config = StationConfig(scene="open_floor", servo=servo)
    seen = watch(make_station(config, plant=plant, faults=faults), AT_S + 0.4)
    quiet_before(seen)
    assert seen.counts[fault] >= 15
    damped_in_time(seen)


def test_poses_from_the_future_are_not_taken():
    """Nor do they make all that come later old: the box is seen again when its clock is right."""
    ahead = InjectedFault(signal="stamps", kind="add", value=5.0, from_s=0.3, until_s=0.6)
    seen = watch(make_station(StationConfig(scene="open_floor"), faults=[ahead]), 1.0, 0.3)
    quiet_before(seen)
    # the pelvis has moved on meanwhile, and the guard with it
    assert set(seen.counts) == {Fault.BOX_LATE, Fault.POSE_LATE}
    assert seen.counts[Fault.BOX_LATE] == 11 and seen.fault[-1] is Fault.NONE


@pytest.mark.slow
@pytest.mark.parametrize("lost_s", [0.3, 1.0, 3.0])
def test_a_box_that_is_lost_for_a_while(lost_s):
    """Its pose is held; from 0.5 s on the robot stands; when it is seen again the robot walks on."""
    station = make_station(StationConfig(scene="open_floor"), faults=lost_box(AT_S, AT_S + lost_s))
    seen = watch(station, AT_S + lost_s + 3.0)
    quiet_before(seen)
    assert set(seen.counts) == {Fault.BOX_LATE} and seen.up.min() > 0.9
    stands = np.array([a is Answer.STOP_WALKING for a in seen.answer])
    assert stands.sum() == pytest.approx(max(0.0, lost_s - 0.5) / 0.02, abs=2)
    assert not stands[seen.time_s > lost_s + 0.03].any()
    assert np.linalg.norm(seen.state[-1, :2] - station.scene.goal) < 0.3, "it arrives"


def test_a_held_box_is_near_the_true_one():
    station = make_station(StationConfig(scene="open_floor", log_hz=50.0), faults=lost_box(0.2))
    seen = watch(station, 0.68, 0.2)
    assert seen.counts.keys() == {Fault.BOX_LATE} and not any(seen.answer)
    guard = station.GetSubsystemByName("percept_guard")
    from hotice.policy.percept import Percept
    from hotice.systems import read_logs

    simulator = Simulator(station)
    simulator.AdvanceTo(0.68)
    logs = read_logs(station, simulator.get_context())
    held, true = Percept(logs["percept_guard.percept"].value[-1]), logs["state_adaptor.robot_state"].value[-1]
    assert np.linalg.norm(held.p_WO - true[36:39]) < 0.03
    frozen = Percept(logs["faulty_percept.signal"].value[-1])
    assert np.linalg.norm(frozen.p_WO - true[36:39]) > 0.05, "in the world it stood still"
    np.testing.assert_allclose(held.p_WOK, held.p_WO + guard._p_OK @ held.R_WO.T, atol=1e-12)
    np.testing.assert_allclose(held.R_WO.T @ held.R_WO, np.eye(3), atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize(
    "faults, fault",
    [
        (one("robot_state", ONE, until_s=AT_S + 0.02), Fault.STATE_NOT_FINITE),
        (one("command", until_s=AT_S + 0.04), Fault.COMMAND_NOT_FINITE),
        (one("percept", BOX[:3], kind="add", value=0.3, until_s=AT_S + 0.04), Fault.BOX_JUMP),
        (one("percept", (0, 1), kind="add", value=0.4, until_s=AT_S + 0.04), Fault.POSE_JUMP),
        (state("late", value=0.04), Fault.STATE_LATE),
    ],
)
def test_what_is_over_at_once_is_counted_and_passed_over(faults, fault):
    seen = faulty(faults)
    quiet_before(seen)
    assert seen.counts[fault] >= 1 and Answer.DAMP not in seen.answer and seen.up.min() > 0.85
    assert seen.state[-1, 0] > 1.3


class GivesUp:
    """A policy that fails from its n-th step on."""

    def __init__(self, policy, answer):
        self.policy, self.answer, self.left = policy, answer, round(AT_S / 0.02)
        self.name, self.meta, self.layout = policy.name, policy.meta, policy.layout

    def run(self, observation):
        self.left -= 1
        if self.left >= 0:
            return self.policy.run(observation)
        if isinstance(self.answer, Exception):
            raise self.answer
        return np.full((1, g1.ACTIONS), self.answer, dtype=np.float32)


@pytest.mark.parametrize(
    "answer, fault, message",
    [
        (np.nan, Fault.ACTION_INVALID, "the action is not finite"),
        (RuntimeError("no memory"), Fault.CONTROLLER_ERROR, "RuntimeError: no memory"),
    ],
)
def test_a_policy_that_gives_up_while_walking(answer, fault, message):
    station = make_station(StationConfig(scene="open_floor"))
    policy = station.GetSubsystemByName("policy")
    policy.policy = GivesUp(policy.policy, answer)
    simulator = Simulator(station)
    seen = watch(station, 1.5, simulator=simulator)
    quiet_before(seen)
    assert seen.counts[fault] >= 40 and seen.fault[-1] is fault
    damped_in_time(seen)
    assert policy.message(policy.GetMyContextFromRoot(simulator.get_context())) == message


class Unsolvable:
    """A solver that gives up from a moment on."""

    def __init__(self, solver):
        self.solver, self.gives_up = solver, False

    def solve(self, guess):
        return False if self.gives_up else self.solver.solve(guess)


@pytest.mark.slow
@pytest.mark.parametrize("how", ["no solution", "an exception"])
def test_a_walk_whose_qp_gives_up(how, monkeypatch):
    pytest.importorskip("pinocchio")
    station = make_station(StationConfig(scene="open_floor"), controller="walk")
    walk = station.GetSubsystemByName("walk")
    simulator = Simulator(station)
    simulator.AdvanceTo(AT_S - 0.001)
    if how == "an exception":

        def raises(*_):
            raise ValueError("matrix is singular")

        monkeypatch.setattr(walk.controller, "step", raises)
    else:
        qp = walk.controller.qp if hasattr(walk.controller, "qp") else walk.controller._qp
        solver = Unsolvable(qp._solver)
        solver.gives_up = True
        monkeypatch.setattr(qp, "_solver", solver)
    monitor = station.GetSubsystemByName("safety_monitor")
    context = monitor.GetMyContextFromRoot(simulator.get_context())
    simulator.AdvanceTo(2.0)
    counts = monitor.GetOutputPort("faults").Eval(context)
    assert counts[Fault.CONTROLLER_ERROR] >= 60
    answer, fault = monitor.GetOutputPort("answer").Eval(context)
    assert Answer(int(answer)) in (Answer.HOLD, Answer.DAMP) and Fault(int(fault)) is Fault.CONTROLLER_ERROR
    message = walk.message(walk.GetMyContextFromRoot(simulator.get_context()))
    assert ("matrix is singular" if how == "an exception" else "fallback") in message


@pytest.mark.slow
@pytest.mark.parametrize("plant", ["mujoco", "drake"])
def test_a_robot_that_is_pushed_over_under_a_nan_command(plant):
    """It is damped when it leans by 60 degrees, not held stiff for the command's sake."""
    config = StationConfig(servo="motor")
    station = make_station(config, plant=plant, controller="hold", faults=one("command"))
    simulator = Simulator(station)
    system = station.GetSubsystemByName("plant")
    if plant == "mujoco":
        qvel = np.zeros(system.nv)
        qvel[0] = 2.5
        context = system.GetMyMutableContextFromRoot(simulator.get_mutable_context())
        system.set_state(context, station.start_qpos, qvel)
    else:
        context = system.plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
        v = system.plant.GetVelocities(context)
        v[system.plant.GetBodyByName("pelvis").floating_velocities_start_in_v() + 3] = 2.5
        system.plant.SetVelocities(context, v)
    seen = watch(station, 2.0, simulator=simulator)
    assert seen.answer[-1] is Answer.DAMP and seen.counts[Fault.COMMAND_NOT_FINITE] >= 50
    over = next((t for t, up in zip(seen.time_s, seen.up, strict=True) if up < 0.5), np.inf)
    assert seen.damped_s() <= over + 0.021 and seen.state[-1, 2] < 0.45


def test_without_faults_a_station_injects_none():
    names = {s.get_name() for s in make_station().GetSystems()}
    assert {"percept_guard", "now"} <= names and not any(n.startswith("faulty") for n in names)


def test_injected_faults_are_checked():
    with pytest.raises(InvalidStation, match="signal is 'smell': known are robot_state"):
        InjectedFault(signal="smell")
    with pytest.raises(InvalidStation, match="kind is 'odd'"):
        InjectedFault(signal="tick", kind="odd")
    with pytest.raises(InvalidStation, match="until_s is 0.1"):
        InjectedFault(signal="tick", from_s=0.2, until_s=0.1)
    with pytest.raises(InvalidStation, match="value of a late signal is nan"):
        InjectedFault(signal="tick", kind="late")
    with pytest.raises(InvalidStation, match="index is 84"):
        InjectedFault(signal="robot_state", index=(84,))


@pytest.mark.parametrize("controller", ["hold", "walk"])
def test_a_fault_that_nobody_would_answer_is_refused(controller):
    with pytest.raises(InvalidStation, match=f"answered under controller='policy' alone, not under '{controller}'"):
        make_station(StationConfig(scene="open_floor"), controller=controller, faults=one("guidance"))
    make_station(StationConfig(scene="open_floor"), controller="hold", faults=one("tick") + lost_box(0.5))


def test_a_faulty_signal():
    faults = [
        InjectedFault(signal="tick", kind="late", value=0.04, from_s=0.1, until_s=0.2),
        InjectedFault(signal="tick", kind="frozen", from_s=0.3, until_s=0.4),
        InjectedFault(signal="tick", kind="scale", value=-2.0, from_s=0.5),
    ]
    system = FaultySignal(1, faults, 0.02)
    simulator = Simulator(system)
    for k in range(30):
        system.GetInputPort("signal").FixValue(simulator.get_mutable_context(), [float(k)])
        simulator.AdvanceTo(0.02 * k + 0.001)
        (out,) = system.GetOutputPort("signal").Eval(simulator.get_context())
        expected = k - 2 if 5 <= k < 10 else 15 if 15 <= k < 20 else -2 * k if k >= 25 else k
        assert out == pytest.approx(expected), k
