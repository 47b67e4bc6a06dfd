from dataclasses import dataclass, replace

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from hotice.control import Command
from hotice.errors import InvalidStation
from hotice.model.frames import quat_from_yaw, quat_mul, quat_rotate
from hotice.safety import Fault
from hotice.systems.controller_system import UNKNOWN_PHASE, ControllerSystem, measurement_of
from hotice.systems.failing import message_of
from hotice.systems.signals import JOINT_POS, JOINT_VEL


@dataclass
class Count:
    steps: int = 0


class Counter:
    """Torque: steps so far, and the height of the pelvis."""

    rate_hz = 100.0

    def start(self, measurement):
        return Count()

    def step(self, memory, measurement):
        memory = replace(memory, steps=memory.steps + 1)
        torque = np.full(20, float(memory.steps))
        torque[1] = measurement.p_WP[2]
        phase = "first" if memory.steps == 1 else "later" if memory.steps < 4 else "new"
        return Command(torque=torque, phase=phase, faults=memory.steps // 3), memory


@pytest.fixture
def system(robot_state):
    system = ControllerSystem(Counter(), ("first", "later"), np.full(20, -1.0))
    return system


def start(system, robot_state):
    simulator = Simulator(system)
    system.GetInputPort("robot_state").FixValue(simulator.get_mutable_context(), robot_state)
    system.GetInputPort("contact_force").FixValue(simulator.get_mutable_context(), np.zeros(12))
    return simulator


def outputs(system, simulator):
    return [system.GetOutputPort(name).Eval(simulator.get_context()).copy() for name in ("torque", "phase", "faults")]


def test_steps_at_its_own_rate(system, robot_state):
    simulator = start(system, robot_state)
    assert (outputs(system, simulator)[0] == -1.0).all() and system.memory(simulator.get_context()) is None
    seen = []
    for k in range(4):
        simulator.AdvanceTo(0.01 * k + 0.001)
        torque, phase, faults = outputs(system, simulator)
        assert torque[0] == k + 1 and torque[1] == robot_state[2]
        seen.append((float(phase[0]), float(faults[0])))
    assert seen == [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (UNKNOWN_PHASE, 1.0)]


def test_memory_belongs_to_the_context(system, robot_state):
    simulator = start(system, robot_state)
    simulator.AdvanceTo(0.025)
    twin = Simulator(system, simulator.get_context().Clone())
    simulator.AdvanceTo(0.095)
    twin.AdvanceTo(0.035)
    assert system.memory(simulator.get_context()).steps == 10
    assert system.memory(twin.get_context()).steps == 4
    twin.AdvanceTo(0.095)
    np.testing.assert_array_equal(*(outputs(system, s)[0] for s in (simulator, twin)))


def test_measurement(robot_state, rng):
    force = rng.standard_normal(12)
    m = measurement_of(1.5, robot_state, force)
    np.testing.assert_array_equal(m.joint_pos, robot_state[JOINT_POS])
    np.testing.assert_array_equal(m.joint_vel, robot_state[JOINT_VEL])
    for name, value in {
        "p_WP": robot_state[:3],
        "quat_WP": robot_state[3:7],
        "p_WO": robot_state[36:39],
        "quat_WO": robot_state[39:43],
        "v_WP": robot_state[43:46],
        "w_WP_P": robot_state[46:49],
        "v_WO": robot_state[78:81],
        "w_WO_O": robot_state[81:],
        "foot_force_W": force[:6].reshape(2, 3),
        "hand_force_W": force[6:].reshape(2, 3),
    }.items():
        np.testing.assert_allclose(getattr(m, name), value, atol=1e-15, err_msg=name)
    assert m.time_s == 1.5 and m.finite()


def test_measurement_in_another_frame(robot_state, rng):
    """Moving the world and the origin together changes nothing."""
    force, origin = rng.standard_normal(12), (0.4, -1.1, 2.0)
    turn, offset = quat_from_yaw(origin[2]), np.array([*origin[:2], 0.0])
    moved = robot_state.copy()
    for p in (slice(0, 3), slice(36, 39)):
        moved[p] = quat_rotate(turn, robot_state[p]) + offset
    for q in (slice(3, 7), slice(39, 43)):
        moved[q] = quat_mul(turn, robot_state[q])
    for v in (slice(43, 46), slice(78, 81)):
        moved[v] = quat_rotate(turn, robot_state[v])
    m = measurement_of(0.0, moved, quat_rotate(turn, force.reshape(4, 3)).ravel(), origin)
    wanted = measurement_of(0.0, robot_state, force)
    for name, value in vars(wanted).items():
        np.testing.assert_allclose(getattr(m, name), value, atol=1e-12, err_msg=name)


def test_rates_are_checked(robot_state):
    controller = Counter()
    controller.rate_hz = 0.0
    with pytest.raises(InvalidStation, match="rate_hz is 0.0"):
        ControllerSystem(controller, (), np.zeros(20))


class Failing(Counter):
    """Raises at the third step, answers the sixth with a fallback."""

    def step(self, memory, measurement):
        if memory.steps == 2 and not self.raised:
            self.raised = True
            raise RuntimeError("the solver\ngave up")
        command, memory = super().step(memory, measurement)
        return replace(command, faults=int(memory.steps >= 5)), memory

    raised = False


def test_what_a_controller_cannot_answer_is_a_fault_with_its_message(robot_state):
    system = ControllerSystem(Failing(), ("first", "later"), np.full(20, -1.0))
    simulator = start(system, robot_state)
    assert np.isnan(system.GetOutputPort("status").Eval(simulator.get_context())[0])
    seen = []
    for k in range(7):
        simulator.AdvanceTo(0.01 * k + 0.001)
        time_s, fault = system.GetOutputPort("status").Eval(simulator.get_context())
        assert time_s == pytest.approx(0.01 * k)
        seen.append((Fault(int(fault)), outputs(system, simulator)[0][0], system.message(simulator.get_context())))
    gave_up, fell_back = "RuntimeError: the solver gave up", "1 steps were answered with a fallback"
    bad, good = Fault.CONTROLLER_ERROR, Fault.NONE
    assert seen[:3] == [(good, 1.0, ""), (good, 2.0, ""), (bad, 2.0, gave_up)], "the torque before is kept"
    assert seen[3:] == [(good, 3.0, gave_up), (good, 4.0, gave_up), (bad, 5.0, fell_back), (good, 6.0, fell_back)]


@pytest.mark.parametrize("bad", [np.nan, np.inf, -1e6])
def test_no_step_is_made_with_a_velocity_that_cannot_be(robot_state, bad):
    """The memory stays what it was: what came of NaN would stay there."""
    system = ControllerSystem(Counter(), ("first", "later"), np.full(20, -1.0))
    simulator = start(system, robot_state)
    simulator.AdvanceTo(0.001)
    torque, steps = outputs(system, simulator)[0], system.memory(simulator.get_context()).steps
    wrong = robot_state.copy()
    wrong[JOINT_VEL[3]] = bad
    system.GetInputPort("robot_state").FixValue(
        system.GetMyMutableContextFromRoot(simulator.get_mutable_context()), wrong
    )
    simulator.AdvanceTo(0.011)
    context = simulator.get_context()
    assert Fault(int(system.GetOutputPort("status").Eval(context)[1])) is Fault.STATE_IMPOSSIBLE
    assert system.memory(context).steps == steps and "no step was made" in system.message(context)
    np.testing.assert_array_equal(outputs(system, simulator)[0], torque)


def test_a_message_can_be_written_whatever_it_holds():
    assert message_of(ValueError("a\n  file \udcff.stl")) == "ValueError: a file \\udcff.stl"
