"""Whoever watches a station judges by the rules of the task: a robot that crouches with its load has not fallen."""

import mujoco
import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

pytest.importorskip("pinocchio")

from hotice.model.carry import Posture, solve_carry
from hotice.model.robot_state import RobotState
from hotice.safety import Fault
from hotice.systems.hand_over.stage import VERDICTS, RehearsalStage
from hotice.systems.logs import SignalLog
from hotice.systems.record.hand_over import report_hand_over
from hotice.systems.record.play import Referee
from hotice.systems.record.rollout import judge
from hotice.systems.safety_monitor import SafePosture, SafetyLimits, SafetyMonitor
from hotice.task.rules import UPRIGHT


@pytest.fixture(scope="module")
def crouching(station):
    """A station, and the state (84,) of a robot that carries its object with the pelvis at 0.48 m."""
    carry = solve_carry(station.carry.carried, Posture(pelvis_height_m=0.48, lean_rad=0.2))
    return station, np.concatenate(RobotState.from_carry(carry).to_mujoco(29))


def told(station, state):
    """By the record of a rollout, the report of a hand-over, what ends a run to look at, and a rehearsal."""
    logs = {
        name: SignalLog(time_s=np.zeros(1), value=np.array([value]))
        for name, value in (
            ("mode_selector.mode", [1.0]),
            ("mode_selector.verdict", [0.0]),
            ("mode_selector.walk_verdict", [-1.0]),
            ("state_adaptor.robot_state", state),
        )
    }
    stage = RehearsalStage(station.setup)
    data = mujoco.MjData(stage.model)
    data.qpos[:], data.qvel[:] = stage.start(state, 0.0)
    mujoco.mj_forward(stage.model, data)
    report = report_hand_over(station, logs)
    return (
        judge(station, np.zeros(1), state[None, :43]),
        report.failure,
        Referee(station)(state),
        VERDICTS[stage.verdict(data)],
    )


def test_a_valid_carry_state_is_a_fall_nowhere(crouching):
    station, state = crouching
    assert state[2] == pytest.approx(0.48, abs=0.01)
    assert told(station, state) == ("timeout", "", "", "fit")


def test_so_are_a_fall_and_a_drop(crouching):
    station, state = crouching
    low, away, leaning = state.copy(), state.copy(), state.copy()
    low[[2, 38]] += 0.34 - state[2]
    away[37] += 0.16
    leaning[3:7] = np.cos(0.55), 0.0, np.sin(0.55), 0.0  # 63 degrees
    for fallen in (low, leaning):
        assert told(station, fallen) == ("fall",) * 4
    assert told(station, away) == ("drop",) * 4


def test_the_monitor_knows_the_same_lean(crouching):
    station, state = crouching
    monitor = SafetyMonitor(SafePosture.of(station.carry), SafetyLimits(falling_rad=np.pi), 0.02)
    for degrees, fault in ((59.0, Fault.NONE), (61.0, Fault.TILT)):
        half = np.deg2rad(degrees) / 2
        state = state.copy()
        state[3:7] = np.cos(half), 0.0, np.sin(half), 0.0
        simulator = Simulator(monitor)
        for name, value in (("robot_state", state), ("tick", [0.0]), ("command", np.zeros(20))):
            monitor.GetInputPort(name).FixValue(simulator.get_mutable_context(), value)
        simulator.AdvanceTo(0.001)
        assert monitor.GetOutputPort("answer").Eval(simulator.get_context())[1] == fault
    assert np.cos(SafetyLimits().tilt_rad) == pytest.approx(UPRIGHT)
