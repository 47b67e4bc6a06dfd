"""The last word before the motors: commands pass while finite and the state is sound, else a safe posture is held."""

# pydrake's stubs type arrays as numpy does not:
# pyright: reportArgumentType=false

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import BasicVector, Context, LeafSystem, State

from hotice import checks
from hotice.compiled import compiled
from hotice.model import g1
from hotice.model.carry import CarryState
from hotice.model.joint_limits import position_limits, torque_limits
from hotice.systems.joint_pd import pd_torque
from hotice.systems.signals import JOINT_POS, JOINT_VEL, NUM_JOINTS, ROBOT_STATE
from hotice.task.rules import UPRIGHT

Array = NDArray[np.float64]


class Fault(IntEnum):
    """Why a command did not pass; `NONE`: it did."""

    NONE = 0
    STATE = 1
    """The measured state is not finite, or the pelvis' quaternion far from unit length."""
    COMMAND = 2
    """The command is not finite."""
    TILT = 3
    """The pelvis leans too far: the robot falls; kept until the state is set anew."""
    JOINT_LIMIT = 4
    """A joint is beyond its range."""


@dataclass(frozen=True, kw_only=True)
class SafetyLimits:
    """When commands no longer pass."""

    tilt_rad: float = math.acos(UPRIGHT)
    """Largest lean of the pelvis, at most π: a fall, as in the task."""
    joint_margin_rad: float = 0.1
    """How far a joint may be pressed beyond its range."""

    def __post_init__(self) -> None:
        # it acts by its cosine, which an angle beyond π would turn round
        checks.number("tilt_rad", self.tilt_rad, checks.Range(least=0, most=math.pi, unit="rad"))
        checks.numbers(self, checks.NOT_NEGATIVE, "joint_margin_rad")


@dataclass(frozen=True, kw_only=True, eq=False)
class SafePosture:
    """Joint targets [rad] and static torques [N m] that hold; middle and half of the joint ranges [rad]; gains, limits.

    All (20,), order `g1.ACTION_JOINTS`.
    """

    target: Array
    torque: Array
    middle: Array
    half_range: Array
    kp: Array
    kd: Array
    limit: Array

    @classmethod
    def of(cls, carry: CarryState) -> SafePosture:
        """The posture of a carry state: object held, knees bent."""
        low, high = position_limits(g1.ACTION_JOINTS)
        kp, kd = g1.gains()
        return cls(
            target=carry.joint_target,
            torque=carry.torque,
            middle=0.5 * (low + high),
            half_range=0.5 * (high - low),
            kp=kp,
            kd=kd,
            limit=torque_limits(g1.ACTION_JOINTS),
        )


def find_fault(state: Array, command: Array, posture: SafePosture, limits: SafetyLimits) -> Fault:
    """The first fault of a robot state (84,) and a command (20,)."""
    lean, margin = math.cos(limits.tilt_rad), limits.joint_margin_rad
    return Fault(_fault_code(state, command, posture.middle, posture.half_range, lean, margin))


@compiled
def _fault_code(state, command, middle, half_range, cos_tilt, margin):
    for value in state:
        if not math.isfinite(value):
            return 1
    for value in command:
        if not math.isfinite(value):
            return 2
    length2 = state[3] * state[3] + state[4] * state[4] + state[5] * state[5] + state[6] * state[6]
    if abs(length2 - 1.0) > 0.2:
        return 1
    if 1.0 - 2.0 * (state[4] * state[4] + state[5] * state[5]) < cos_tilt:
        return 3
    for j in range(len(middle)):
        if abs(state[JOINT_POS[j]] - middle[j]) - half_range[j] > margin:
            return 4
    return 0


def safe_torque(state: Array, posture: SafePosture, fault: Fault) -> Array:
    """Torques (20,) that hold the posture, only damp in a fall, and are static where a joint's state is unknown."""
    q, qd = state[JOINT_POS], state[JOINT_VEL]
    known = np.isfinite(q) & np.isfinite(qd)
    target = q if fault is Fault.TILT else posture.target
    with np.errstate(invalid="ignore"):
        torque = pd_torque(target, q, qd, posture.kp, posture.kd, posture.limit)
    return np.where(known, torque, 0.0 if fault is Fault.TILT else posture.torque)


def safe_target(state: Array, posture: SafePosture, fault: Fault) -> Array:
    """Joint targets (20,) of the posture; of a falling robot, where its joints are: its servos then mostly damp."""
    q = state[JOINT_POS]
    return np.where(np.isfinite(q), q, posture.target) if fault is Fault.TILT else posture.target


class SafetyMonitor(LeafSystem):
    """Inputs `robot_state` (84,), `command` (20,). Outputs `command` (20,), safe, and `faults` (5,).

    `faults` holds how many control steps began with each `Fault` but NONE, and the present one.

    State and command are checked at the start of each control period, and a fault lasts at least as long as the period.
    In between every command is tested for finiteness, so that none that is not finite ever passes.

    Args:
        posture: what is held after a fault. limits: what is one.
        control_dt_s: period of the checks.
        torques: commands are torques [N m]; otherwise joint targets [rad] of the motors' servos.
    """

    def __init__(self, posture: SafePosture, limits: SafetyLimits, control_dt_s: float, torques: bool = True) -> None:
        super().__init__()
        self.posture, self.limits, self.torques = posture, limits, torques
        index = self.DeclareDiscreteState(5)
        self._state = self.DeclareVectorInputPort("robot_state", ROBOT_STATE)
        self._command = self.DeclareVectorInputPort("command", NUM_JOINTS)
        reads = {self.discrete_state_ticket(index), self._state.ticket(), self._command.ticket()}
        self.DeclareVectorOutputPort("command", NUM_JOINTS, self._output_command, reads)
        self.DeclareStateOutputPort("faults", index)
        self.DeclarePeriodicUnrestrictedUpdateEvent(control_dt_s, 0.0, self._check)

    def _check(self, context: Context, state: State) -> None:
        before = fault = int(context.get_discrete_state_vector().value()[4])
        if before != Fault.TILT:
            fault = find_fault(self._state.Eval(context), self._command.Eval(context), self.posture, self.limits)
        if fault or before:
            counts = state.get_mutable_discrete_state(0).get_mutable_value()
            counts[4] = fault
            if fault:
                counts[fault - 1] += 1

    def _output_command(self, context: Context, output: BasicVector) -> None:
        command = self._command.Eval(context)
        held = context.get_discrete_state_vector().value()[4]
        if not held and math.isfinite(command.dot(command)):
            output.SetFromVector(command)
        else:
            safe = safe_torque if self.torques else safe_target
            output.SetFromVector(safe(self._state.Eval(context), self.posture, Fault(int(held)) or Fault.COMMAND))
