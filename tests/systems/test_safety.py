import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from hotice.errors import InvalidConfig
from hotice.systems.hand_over.mode_selector import HandOver, ModeSelector, blend
from hotice.systems.safety_monitor import Fault, SafePosture, SafetyLimits, SafetyMonitor, find_fault, safe_torque
from hotice.systems.signals import JOINT_POS, JOINT_VEL

LIMITS = SafetyLimits()


@pytest.fixture(scope="module")
def posture(carry):
    return SafePosture.of(carry)


def changed(state, index, value):
    out = state.copy()
    out[index] = value
    return out


def bad_states(state, posture):
    lying = changed(state, slice(3, 7), [0.6, 0.0, 0.8, 0.0])
    return {
        Fault.STATE: changed(state, 12, np.nan),
        Fault.TILT: lying,
        Fault.JOINT_LIMIT: changed(state, JOINT_POS[3], posture.middle[3] + posture.half_range[3] + 0.2),
    }


def test_faults(robot_state, posture):
    torque = np.zeros(20)
    assert find_fault(robot_state, torque, posture, LIMITS) is Fault.NONE
    for fault, state in bad_states(robot_state, posture).items():
        assert find_fault(state, torque, posture, LIMITS) is fault
    assert find_fault(robot_state, changed(torque, 3, np.inf), posture, LIMITS) is Fault.COMMAND
    assert find_fault(changed(robot_state, 12, np.inf), torque, posture, LIMITS) is Fault.STATE
    for quat in (np.zeros(4), 1.2 * robot_state[3:7], 0.8 * robot_state[3:7]):
        assert find_fault(changed(robot_state, slice(3, 7), quat), torque, posture, LIMITS) is Fault.STATE
    rounded = changed(robot_state, slice(3, 7), 1.01 * robot_state[3:7])
    assert find_fault(rounded, torque, posture, LIMITS) is Fault.NONE


def test_safe_torque(robot_state, posture, carry):
    q, qd = robot_state[JOINT_POS], robot_state[JOINT_VEL]
    held = safe_torque(robot_state, posture, Fault.COMMAND)
    np.testing.assert_allclose(
        held, np.clip(posture.kp * (carry.joint_target - q) - posture.kd * qd, -posture.limit, posture.limit)
    )
    blind = safe_torque(changed(robot_state, JOINT_POS[3], np.nan), posture, Fault.STATE)
    np.testing.assert_array_equal(np.delete(blind, 3), np.delete(held, 3))
    assert blind[3] == carry.torque[3]
    np.testing.assert_allclose(safe_torque(robot_state, posture, Fault.TILT), -posture.kd * qd)


def monitor(posture, torques=True):
    return SafetyMonitor(posture, LIMITS, 0.02, torques)


def advance(simulator, system, time_s, **inputs):
    for name, value in inputs.items():
        system.GetInputPort(name).FixValue(simulator.get_mutable_context(), value)
    simulator.AdvanceTo(time_s)
    context = simulator.get_context()
    return (system.GetOutputPort(name).Eval(context).copy() for name in ("command", "faults"))


def test_good_commands_pass(robot_state, posture, rng):
    system = monitor(posture)
    torque = rng.standard_normal(20)
    command, faults = advance(Simulator(system), system, 0.1, robot_state=robot_state, command=torque)
    np.testing.assert_array_equal(command, torque)
    assert not faults.any()


@pytest.mark.parametrize("fault", [Fault.STATE, Fault.JOINT_LIMIT])
def test_faults_are_counted_and_pass(robot_state, posture, fault):
    system = monitor(posture)
    simulator, torque, bad = Simulator(system), np.ones(20), bad_states(robot_state, posture)[fault]
    command, faults = advance(simulator, system, 0.05, robot_state=bad, command=torque)  # at 0, 0.02 and 0.04 s
    np.testing.assert_array_equal(command, safe_torque(bad, posture, fault))
    assert np.isfinite(command).all() and faults[fault - 1] == 3 and faults[4] == fault
    command, faults = advance(simulator, system, 0.09, robot_state=robot_state, command=torque)
    np.testing.assert_array_equal(command, torque)
    assert faults[fault - 1] == 3 and faults[4] == Fault.NONE


def test_a_fall_is_final(robot_state, posture):
    system = monitor(posture)
    simulator, lying = Simulator(system), bad_states(robot_state, posture)[Fault.TILT]
    advance(simulator, system, 0.01, robot_state=lying, command=np.ones(20))
    command, faults = advance(simulator, system, 0.1, robot_state=robot_state, command=np.ones(20))
    np.testing.assert_array_equal(command, safe_torque(robot_state, posture, Fault.TILT))
    assert faults[4] == Fault.TILT and faults[Fault.TILT - 1] >= 5


def test_no_command_passes_that_is_not_finite(robot_state, posture):
    """Also between two checks."""
    system = monitor(posture)
    simulator = Simulator(system)
    advance(simulator, system, 0.001, robot_state=robot_state, command=np.ones(20))
    command, faults = advance(simulator, system, 0.002, command=np.full(20, np.nan))
    np.testing.assert_array_equal(command, safe_torque(robot_state, posture, Fault.COMMAND))
    assert not faults.any()
    _, faults = advance(simulator, system, 0.021)
    assert faults[Fault.COMMAND - 1] == 1


def test_joint_targets(robot_state, posture, carry):
    system = monitor(posture, torques=False)
    simulator = Simulator(system)
    command, _ = advance(simulator, system, 0.001, robot_state=robot_state, command=carry.joint_pos)
    np.testing.assert_array_equal(command, carry.joint_pos)
    command, faults = advance(simulator, system, 0.021, robot_state=np.full(84, np.nan))
    np.testing.assert_array_equal(command, carry.joint_target)
    assert faults[0] == 1
    lying = bad_states(robot_state, posture)[Fault.TILT]
    command, _ = advance(simulator, system, 0.041, robot_state=lying)
    np.testing.assert_array_equal(command, lying[JOINT_POS])


def test_limits_are_checked():
    with pytest.raises(InvalidConfig, match="tilt_rad is nan"):
        SafetyLimits(tilt_rad=float("nan"))
    with pytest.raises(InvalidConfig, match="tilt_rad is 57: a finite number from 0 to 3.14159 rad is needed"):
        SafetyLimits(tilt_rad=57)
    with pytest.raises(InvalidConfig, match="joint_margin_rad is -0.1"):
        SafetyLimits(joint_margin_rad=-0.1)
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
