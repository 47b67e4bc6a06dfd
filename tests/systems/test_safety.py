"""The safety monitor alone: each fault found, counted and answered; damping final; nothing bad ever passes."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from hotice.errors import InvalidConfig
from hotice.safety import Answer, Fault
from hotice.systems.hand_over.mode_selector import HandOver, ModeSelector, blend
from hotice.systems.safety_monitor import (
    LEGS_AND_WAIST,
    SafePosture,
    SafetyLimits,
    SafetyMonitor,
    damping_target,
    damping_torque,
    held_torque,
)
from hotice.systems.signals import JOINT_POS, JOINT_VEL, ROOT_RATE

LIMITS = SafetyLimits()
LYING = [0.6, 0.0, 0.8, 0.0]


@pytest.fixture(scope="module")
def posture(carry):
    return SafePosture.of(carry)


def changed(state, index, value):
    out = state.copy()
    out[index] = value
    return out


class Watched:
    """A monitor with a robot that moves a little and a clock that ticks, unless told otherwise."""

    def __init__(self, posture, state, torques=False, **more):
        self.system = SafetyMonitor(posture, LIMITS, 0.02, torques)
        self.simulator, self.state = Simulator(self.system), state
        self.command = np.zeros(20) if torques else posture.target.copy()
        self.fixed, self.k = more, 0

    def step(self, **inputs):
        """One check and what the outputs are after it: command, answer, fault, damped joints."""
        now, context = 0.02 * self.k, self.simulator.get_mutable_context()
        moving = self.state + 1e-6 * self.k
        values = {"robot_state": moving, "tick": [now], "command": self.command, **self.fixed, **inputs}
        for name, value in values.items():
            self.system.GetInputPort(name).FixValue(context, value)
        self.simulator.AdvanceTo(now + 0.001)
        self.k += 1
        answer, fault = (int(v) for v in self.output("answer"))
        return self.output("command"), Answer(answer), Fault(fault), self.output("damped")

    def output(self, name):
        return self.system.GetOutputPort(name).Eval(self.simulator.get_context()).copy()

    @property
    def counts(self):
        return {Fault(i): int(n) for i, n in enumerate(self.output("faults")) if i and n}


@pytest.fixture
def watched(posture, robot_state):
    return Watched(posture, robot_state)


def test_good_commands_pass(posture, robot_state, rng):
    for torques in (False, True):
        w = Watched(posture, robot_state, torques)
        for _ in range(5):
            w.command = (0.0 if torques else posture.target) + 0.1 * rng.standard_normal(20)
            command, answer, fault, damped = w.step()
            np.testing.assert_array_equal(command, w.command)
            assert answer is Answer.PASS and fault is Fault.NONE and not damped.any()
        assert not w.counts and w.output("faults")[0] == 0


BAD_STATES = {
    "NaN joint": ((JOINT_POS[3], np.nan), Fault.STATE_NOT_FINITE),
    "infinite speed": ((JOINT_VEL[3], np.inf), Fault.STATE_NOT_FINITE),
    "NaN gyro": ((ROOT_RATE, np.nan), Fault.STATE_NOT_FINITE),
    "NaN quaternion": ((slice(3, 7), np.nan), Fault.STATE_NOT_FINITE),
    "zero quaternion": ((slice(3, 7), 0.0), Fault.QUATERNION),
    "long quaternion": ((slice(3, 7), 3.0), Fault.QUATERNION),
    "velocity of 1e6": ((JOINT_VEL[3], 1e6), Fault.STATE_IMPOSSIBLE),
    "angle of 1e6": ((JOINT_POS[3], 1e6), Fault.STATE_IMPOSSIBLE),
}


@pytest.mark.parametrize("name", BAD_STATES)
def test_a_bad_state_is_found_at_once_repeated_over_and_damped_within_60_ms(watched, robot_state, name):
    change, fault = BAD_STATES[name]
    watched.step()
    answers = []
    for k in range(5):
        _, answer, cause, damped = watched.step(robot_state=changed(robot_state + 1e-6 * k, *change))
        assert cause is fault and watched.counts[fault] == k + 1
        answers.append(answer)
    assert answers == [Answer.REPEAT] * 3 + [Answer.DAMP] * 2
    np.testing.assert_array_equal(damped, LEGS_AND_WAIST)


def test_one_bad_sample_is_passed_over(watched, robot_state):
    watched.step()
    command, answer, _, _ = watched.step(
        robot_state=changed(robot_state, JOINT_POS[3], np.nan), command=np.full(20, np.nan)
    )
    np.testing.assert_array_equal(command, watched.command)
    assert answer is Answer.REPEAT
    assert watched.step()[1:3] == (Answer.PASS, Fault.NONE)
    assert watched.counts == {Fault.STATE_NOT_FINITE: 1, Fault.COMMAND_NOT_FINITE: 1}


@pytest.mark.parametrize("command", [np.full(20, np.nan), np.full(20, 1e9)])
def test_a_fall_is_damped_whatever_is_commanded(watched, robot_state, command):
    watched.step()
    lying = changed(robot_state, slice(3, 7), LYING)
    _, answer, fault, damped = watched.step(robot_state=lying, command=command)
    assert (answer, fault) == (Answer.DAMP, Fault.TILT)
    np.testing.assert_array_equal(damped, LEGS_AND_WAIST)
    assert watched.counts[Fault.TILT] == 1
    assert watched.counts.keys() & {Fault.COMMAND_NOT_FINITE, Fault.COMMAND_RANGE}


def test_a_fall_is_final_and_the_arms_let_go_after_a_second(watched, robot_state):
    lying = changed(robot_state, slice(3, 7), LYING)
    watched.step(robot_state=lying)
    for k in range(1, 60):
        _, answer, fault, damped = watched.step()
        assert (answer, fault) == (Answer.DAMP, Fault.TILT)
        np.testing.assert_array_equal(damped, LEGS_AND_WAIST if k < 50 else np.ones(20))
    assert watched.counts == {Fault.TILT: 1, Fault.FALLING: 1}


def test_the_arms_of_a_fallen_robot_hold_what_they_held_whatever_is_commanded_later(watched, robot_state):
    """Its controller goes on, and knows nothing of the fall."""
    watched.step()
    watched.step(robot_state=changed(robot_state, slice(3, 7), LYING))
    arms = LEGS_AND_WAIST < 1
    for k in range(5):
        command, answer, _, _ = watched.step(command=watched.command + 0.1 * k)
        assert answer is Answer.DAMP
        np.testing.assert_array_equal(command[arms], watched.command[arms])


@pytest.mark.parametrize("torques", [False, True])
def test_arms_are_not_held_by_torques_of_a_state_that_is_old(posture, robot_state, torques):
    """Servos of joints know their own; torques that are made of what was would swing the arms."""
    w = Watched(posture, robot_state, torques)
    w.step()
    steps = [w.step(tick=[0.0]) for _ in range(8)]
    answers, damped = [s[1] for s in steps], [s[3] for s in steps]
    assert answers[-1] is Answer.DAMP
    np.testing.assert_array_equal(damped[-1], np.ones(20) if torques else LEGS_AND_WAIST)
    for _ in range(2):
        *_, damped = w.step(), w.step()[3]
    np.testing.assert_array_equal(damped, LEGS_AND_WAIST)


@pytest.mark.parametrize(
    "index, value, fault",
    [(JOINT_VEL[3], -46.0, Fault.JOINT_SPEED), (ROOT_RATE.start + 1, 12.1, Fault.GYRO)],
)
def test_what_is_too_fast_falls(watched, robot_state, index, value, fault):
    _, answer, cause, _ = watched.step(robot_state=changed(robot_state, index, value))
    assert (answer, cause) == (Answer.DAMP, fault)


def test_a_joint_beyond_its_range_is_damped_after_100_ms(watched, robot_state, posture):
    beyond = changed(robot_state, JOINT_POS[3], posture.upper[3] + 0.21)
    answers = [watched.step(robot_state=changed(beyond, 0, 0.1 * k) + 1e-9 * k)[1] for k in range(7)]
    assert answers == [Answer.PASS] * 5 + [Answer.DAMP] * 2
    assert watched.counts == {Fault.JOINT_LIMIT: 7}


@pytest.mark.parametrize("torques", [False, True])
@pytest.mark.parametrize("value", [np.nan, np.inf, 1e9])
def test_no_bad_command_passes(posture, robot_state, torques, value):
    """Also between two checks; the last valid one is given again, and after 60 ms the robot is damped."""
    w = Watched(posture, robot_state, torques)
    w.step()
    context, bad = w.simulator.get_mutable_context(), changed(w.command, 5, value)
    w.system.GetInputPort("command").FixValue(context, bad)
    w.simulator.AdvanceTo(0.01)
    np.testing.assert_array_equal(w.output("command"), w.command)
    assert not w.counts
    fault = Fault.COMMAND_RANGE if value == 1e9 else Fault.COMMAND_NOT_FINITE
    for k in range(4):
        command, answer, cause, _ = w.step(command=bad)
        assert cause is fault and w.counts[fault] == k + 1 and np.isfinite(command).all()
        assert answer is (Answer.REPEAT if k < 3 else Answer.DAMP)
        assert k == 3 or (command == w.command).all()


def test_a_leap_of_a_target(watched):
    high = changed(watched.command, 3, watched.system.posture.upper[3])
    watched.step(command=high)
    _, answer, fault, _ = watched.step(command=changed(high, 3, high[3] - 2.4))
    assert (answer, fault) == (Answer.PASS, Fault.NONE)
    watched.step(command=high)
    command, answer, fault, _ = watched.step(command=changed(high, 3, high[3] - 2.6))
    assert (answer, fault) == (Answer.REPEAT, Fault.COMMAND_STEP)
    np.testing.assert_array_equal(command, high)


@pytest.mark.parametrize("fault", [Fault.CONTROLLER_ERROR, Fault.ACTION_INVALID, Fault.OBSERVATION_INVALID])
@pytest.mark.parametrize("speed, last", [(0.6, Answer.DAMP), (0.0, Answer.HOLD)])
def test_a_failing_controller(posture, carry, fault, speed, last):
    """It is repeated over, then a robot that stands still holds the posture; any other is damped."""
    from hotice.model.robot_state import RobotState

    w = Watched(posture, np.concatenate(RobotState.from_carry(carry).to_mujoco(29)))
    w.state[JOINT_VEL[3]] = speed
    answers = [w.step(status=[0.02 * w.k, float(fault)])[1] for _ in range(6)]
    assert answers == [Answer.REPEAT] * 3 + [last] * 3
    assert w.counts == {fault: 6}


def test_a_silent_controller(watched):
    watched.step(status=[0.0, 0.0])
    answers = [watched.step(status=[0.0, 0.0])[1] for _ in range(4)]
    assert answers == [Answer.PASS, Answer.REPEAT, Answer.DAMP, Answer.DAMP]
    assert watched.counts[Fault.COMMAND_LATE] == 3


def test_a_frozen_tick_a_late_one_and_none(posture, robot_state):
    def run(ticks, **inputs):
        w = Watched(posture, robot_state)
        return [w.step(tick=[tick], **inputs)[1:3] for tick in ticks], w.counts

    answers, counts = run([0.0, 0.0, 0.0, 0.0])
    assert [a for a, _ in answers] == [Answer.PASS] * 3 + [Answer.DAMP] and counts == {Fault.STATE_FROZEN: 3}
    answers, counts = run([-0.06, -0.04, -0.02])
    assert answers[0] == (Answer.DAMP, Fault.STATE_LATE) and counts == {Fault.STATE_LATE: 3}
    answers, counts = run([-0.03, -0.01, 0.01, 0.03, 0.05])
    assert {a for a, _ in answers} == {Answer.PASS} and counts == {Fault.STATE_LATE: 5}, "late, but usable"
    answers, counts = run([np.nan] * 5)
    assert [a for a, _ in answers] == [Answer.PASS] * 3 + [Answer.DAMP] * 2 and counts == {Fault.STATE_MISSING: 5}


@pytest.mark.parametrize("code", [len(Fault), 1e9, np.inf, np.nan])
def test_a_fault_that_does_not_exist_is_one_all_the_same(posture, robot_state, code):
    """And is written nowhere else: compiled loops do not look where they write."""
    w = Watched(posture, robot_state)
    for _ in range(3):
        w.step(status=[0.02 * w.k, code], sources=[0.02 * w.k, 0.02 * w.k, 0.0, code])
    assert w.counts == {Fault.CONTROLLER_ERROR: 3, Fault.POSE_INVALID: 3}


def test_stamps_from_the_future(posture, robot_state):
    """A clock that is wrong would hide all that comes late afterwards."""
    w = Watched(posture, robot_state)
    w.step()
    answers = [w.step(tick=[0.02 * w.k + 10.0])[1] for _ in range(5)]
    assert answers == [Answer.PASS] * 3 + [Answer.DAMP] * 2 and w.counts == {Fault.STATE_MISSING: 5}
    w = Watched(posture, robot_state)
    for _ in range(3):
        w.step(status=[0.02 * w.k + 1.0, 0.0], sources=[0.02 * w.k + 1.0, 0.02 * w.k + 0.5, 0.0, 0.0])
    assert w.counts == {Fault.COMMAND_LATE: 3, Fault.POSE_LATE: 3, Fault.BOX_LATE: 3}


def test_numbers_that_stand_still(watched, robot_state):
    answers = [watched.step(robot_state=robot_state)[1] for _ in range(5)]
    assert answers == [Answer.PASS] * 3 + [Answer.DAMP] * 2
    assert watched.counts == {Fault.STATE_FROZEN: 4}


def test_what_is_sensed_of_the_way(posture, robot_state):
    from hotice.policy.guidance import FieldReading
    from hotice.policy.percept import Percept

    percept = Percept(np.zeros(Percept.SIZE))
    percept.p_WP[:], percept.p_WO[:], percept.R_WO[:] = (0.0, 0.0, 0.74), (0.3, 0.0, 0.9), np.eye(3)
    guidance = np.zeros(FieldReading.SIZE)
    seen = {"watched_percept": percept.vector, "watched_guidance": guidance}
    w = Watched(posture, robot_state, **seen)
    assert w.step()[2] is Fault.NONE
    assert w.step(watched_guidance=changed(guidance, 5, np.nan))[1:3] == (Answer.STOP_WALKING, Fault.GUIDANCE_INVALID)
    assert w.step()[1:3] == (Answer.PASS, Fault.NONE)
    under = changed(percept.vector, slice(2, 3), -0.1)
    assert w.step(watched_percept=under)[1:3] == (Answer.PASS, Fault.POSE_INVALID)
    for bad in (np.inf, 1.1e4, -1e300):
        answer, fault = w.step(watched_guidance=changed(guidance, 5, bad))[1:3]
        assert (answer, fault) == (Answer.STOP_WALKING, Fault.GUIDANCE_INVALID)
    for part in ("w_WP_P", "q", "qd"):
        where = Percept.PARTS[part].start + 1
        assert w.step(watched_percept=changed(percept.vector, where, 1e6))[2] is Fault.OBSERVATION_INVALID
        assert w.step()[2] is Fault.NONE
    low = changed(percept.vector, slice(2, 3), 0.3)
    assert w.step(watched_percept=low)[1:3] == (Answer.DAMP, Fault.PELVIS_LOW)


def test_holding(posture, carry):
    """Where the joints were at the last valid command, beside what that was."""
    from hotice.model.robot_state import RobotState

    state = np.concatenate(RobotState.from_carry(carry).to_mujoco(29))
    for torques in (False, True):
        w = Watched(posture, state, torques)
        w.command = w.command + 0.05
        for _ in range(5):
            now = changed(state, JOINT_POS[3], state[JOINT_POS[3]] - 0.02 * (w.k > 1))
            error = [0.02 * w.k, float(Fault.CONTROLLER_ERROR if w.k else 0)]
            command, answer, _, _ = w.step(robot_state=now, command=w.command + 0.01 * w.k, status=error)
        assert answer is Answer.HOLD
        expected = w.command + (changed(np.zeros(20), 3, 0.02 * posture.kp[3]) if torques else 0.0)
        np.testing.assert_allclose(command, expected, atol=1e-12)


def test_damping(robot_state, posture):
    q, qd = robot_state[JOINT_POS], robot_state[JOINT_VEL]
    np.testing.assert_allclose(damping_torque(robot_state, posture), -posture.kd * qd)
    assert not damping_torque(changed(robot_state, JOINT_VEL[3], np.nan), posture)[3]
    np.testing.assert_array_equal(damping_target(robot_state, posture.target), q)
    blind = damping_target(changed(robot_state, JOINT_POS[3], np.nan), posture.target)
    np.testing.assert_array_equal(blind, changed(q, 3, posture.target[3]))
    one = held_torque(robot_state, posture, np.ones(20), q)
    np.testing.assert_allclose(one, np.clip(1.0 - posture.kd * qd, -posture.limit, posture.limit))
    assert held_torque(changed(robot_state, JOINT_POS[3], np.nan), posture, np.ones(20), q)[3] == 1.0


def test_limits_are_checked():
    with pytest.raises(InvalidConfig, match="tilt_rad is nan"):
        SafetyLimits(tilt_rad=float("nan"))
    with pytest.raises(InvalidConfig, match="tilt_rad is 57: a finite number from 0 to 3.14159 rad is needed"):
        SafetyLimits(tilt_rad=57)
    with pytest.raises(InvalidConfig, match="joint_margin_rad is -0.1"):
        SafetyLimits(joint_margin_rad=-0.1)
    with pytest.raises(InvalidConfig, match="step_rad is 0"):
        SafetyLimits(step_rad=0)
    with pytest.raises(InvalidConfig, match="ages is 3"):
        SafetyLimits(ages=3)  # type: ignore[arg-type]
    assert SafetyLimits(tilt_rad=np.pi, joint_margin_rad=7.0).tilt_rad == np.pi


def held(left, right):
    return np.array([0.0, 0.0, 180.0, 0.0, 0.0, 180.0, 0.0, left, 0.0, 0.0, -right, 0.0])


def test_hand_over():
    rule = HandOver(ready_phase=8, settle_s=0.1, blend_s=0.2)
    system = ModeSelector(rule, 0.02)
    simulator = Simulator(system)
    context = simulator.get_mutable_context()
    pickup, carry = np.full(20, 1.0), np.full(20, 5.0)

    def at(time_s, **inputs):
        for name, value in inputs.items():
            system.GetInputPort(name).FixValue(context, value)
        simulator.AdvanceTo(time_s)
        return (system.GetOutputPort(name).Eval(context).copy() for name in ("torque", "mode", "carry_active"))

    torque, mode, active = at(0.2, pickup_torque=pickup, carry_torque=carry, phase=[7.0], contact_force=held(40, 40))
    assert mode == active == 0.0 and (torque == pickup).all()
    at(0.25, phase=[8.0])
    _, mode, _ = at(0.3, contact_force=held(40, 2))  # one hand lost it: the time begins anew
    assert mode == 0.0
    _, mode, _ = at(0.39, contact_force=held(40, 40))
    assert mode == 0.0
    torque, mode, active = at(0.41)  # ready since 0.3, so handed over at 0.4
    assert mode == active == 1.0
    np.testing.assert_allclose(torque, blend(pickup, carry, 0.01 / 0.2))
    torque, mode, _ = at(0.7, phase=[9.0], contact_force=np.zeros(12))
    assert mode == 1.0 and (torque == carry).all()
    with pytest.raises(InvalidConfig, match="blend_s"):
        HandOver(ready_phase=0, blend_s=-1.0)
