"""Percepts in which what is lost or cannot be is replaced: object and pelvis by where they were."""

# pydrake's stubs type arrays as numpy does not:
# pyright: reportArgumentType=false, reportCallIssue=false, reportIndexIssue=false, reportReturnType=false

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import BasicVector, Context, LeafSystem, State

from hotice.model import g1
from hotice.model.carry import CarryState
from hotice.model.frames import mat_to_quat, rotation_z
from hotice.model.robot_state import RobotState
from hotice.policy.measuring import attitude
from hotice.policy.percept import Percept, PerceptModel
from hotice.safety import Fault, MeasurementLimits, judge
from hotice.safety.jumps import GATE, POSE, empty_gate, pass_gate
from hotice.safety.limits import BOX_JUMP, POSE_JUMP
from hotice.systems.signals import PERCEPT, SOURCES, STAMPS

Array = NDArray[np.float64]
_GOOD, _BOX, _PLACE = slice(0, PERCEPT), slice(PERCEPT, PERCEPT + GATE), slice(PERCEPT + GATE, PERCEPT + 2 * GATE)
_STAMPS = slice(PERCEPT + 2 * GATE, PERCEPT + 2 * GATE + 2)
_SIZE = _STAMPS.stop
_AHEAD_S = 1e-6
"""Rounding of times."""


class PerceptGuard(LeafSystem):
    """Inputs `percept` (119,), `stamps` (2,). Outputs `percept` (119,), `sources` (4,), see `signals`.

    `stamps`: when the poses of pelvis and object in the percept were made [s]. An object's pose that is old, none, far
    from the pelvis or a jump is replaced by the last accepted one in the pelvis frame, where a carried object hardly
    moves; a pelvis' pose by the last accepted place, turned by the gyro, with keypoints of the measured joints.

    Args:
        carry: how the object is carried, and the wrists.
        control_dt_s: period of the percepts.
    """

    def __init__(self, carry: CarryState, control_dt_s: float) -> None:
        super().__init__()
        carried, self._dt_s = carry.carried, control_dt_s
        self._model, self._qpos = PerceptModel(carried), RobotState.from_carry(carry).to_mujoco(29)[0]
        self._p_OK, self._aligned = carried.keypoints(), carried.keypoints_world_aligned
        self._limits = judge.measurement_array(MeasurementLimits())
        start = np.full(_SIZE, np.nan)
        start[_BOX] = start[_PLACE] = empty_gate()
        self.DeclareDiscreteState(start)
        self._percept = self.DeclareVectorInputPort("percept", PERCEPT)
        self._stamps = self.DeclareVectorInputPort("stamps", STAMPS)
        self.DeclareVectorOutputPort("percept", PERCEPT, self._output_percept)
        self.DeclareVectorOutputPort("sources", SOURCES, self._output_sources)
        self.DeclarePeriodicUnrestrictedUpdateEvent(control_dt_s, 0.0, self._update)

    def _output_percept(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._guard(context)[0])

    def _output_sources(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._guard(context)[1])

    def _update(self, context: Context, state: State) -> None:
        state.get_mutable_discrete_state(0).SetFromVector(self._guard(context)[2])

    def _guard(self, context: Context) -> tuple[Array, Array, Array]:
        """Percept, sources and memory from now on."""
        percept, stamps = Percept(self._percept.Eval(context).copy()), self._stamps.Eval(context)
        memory = context.get_discrete_state_vector().value().copy()
        good, known = Percept(memory[_GOOD]), memory[_STAMPS]
        found = np.full(len(Fault), np.inf)
        with np.errstate(all="ignore"):
            judge.find_pose(found, 0.0, percept.p_WP, percept.p_WO, percept.R_WO.ravel(), self._limits)
        faults = [Fault.NONE, Fault.NONE]
        now_s = context.get_time()
        if _is_new(stamps[0], known[0], now_s):
            faults[0] = self._judge_place(percept, bool(np.isfinite(found[Fault.POSE_INVALID])), memory[_PLACE])
            known[0] = known[0] if faults[0] else stamps[0]
        if faults[0] and not np.isnan(good.p_WP[0]):
            self._stay(percept, good)
        R_WP = attitude(float(percept.yaw[0]), percept.gravity_P)
        new = _is_new(stamps[1], known[1], now_s) and not faults[0]
        if new:
            invalid = bool(np.isfinite(found[Fault.BOX_INVALID])) or not np.isfinite(percept.p_WOK).all()
            faults[1] = self._judge_box(percept, R_WP, invalid, memory[_BOX])
            known[1] = known[1] if faults[1] else stamps[1]
        if (not new or faults[1]) and not np.isnan(memory[_BOX][0]):
            self._hold(percept, R_WP, memory[_BOX][:POSE])
        if np.isfinite(percept.vector).all():
            good.vector[:] = percept.vector
        sources = np.array([known[0], known[1], *faults], dtype=float)
        return percept.vector, sources, memory

    def _judge_place(self, percept: Percept, invalid: bool, gate: Array) -> Fault:
        if invalid or not np.isfinite(percept.p_WK).all() or not np.isfinite(percept.yaw[0]):
            return Fault.POSE_INVALID
        pose = np.concatenate([percept.p_WP, rotation_z(float(percept.yaw[0])).ravel()])
        return Fault.NONE if pass_gate(gate, pose, POSE_JUMP) else Fault.POSE_JUMP

    def _judge_box(self, percept: Percept, R_WP: Array, invalid: bool, gate: Array) -> Fault:
        if invalid:
            return Fault.BOX_INVALID
        pose = np.concatenate([(percept.p_WO - percept.p_WP) @ R_WP, (R_WP.T @ percept.R_WO).ravel()])
        return Fault.NONE if pass_gate(gate, pose, BOX_JUMP) else Fault.BOX_JUMP

    def _stay(self, percept: Percept, good: Percept) -> None:
        """Writes into a percept where the pelvis was, turned by the gyro, and the keypoints there."""
        percept.p_WP[:] = good.p_WP
        percept.yaw[:] = good.yaw - self._dt_s * float(percept.gravity_P @ percept.w_WP_P)
        qpos = self._qpos.copy()
        qpos[g1.ROOT_POS] = percept.p_WP
        if np.isfinite(percept.gravity_P).all():
            qpos[g1.ROOT_QUAT] = mat_to_quat(attitude(float(percept.yaw[0]), percept.gravity_P))
        percept.p_WK[:] = self._model.keypoints_at(qpos)(percept.q)

    def _hold(self, percept: Percept, R_WP: Array, pose: Array) -> None:
        """Writes the object's pose (12,) in the pelvis frame into a percept."""
        percept.p_WO[:] = percept.p_WP + R_WP @ pose[:3]
        percept.R_WO[:] = R_WP @ pose[3:].reshape(3, 3)
        percept.p_WOK[:] = percept.p_WO + (self._p_OK if self._aligned else self._p_OK @ percept.R_WO.T)


def _is_new(stamp: float, known: float, now_s: float) -> bool:
    """Whether a pose was made since the known one; not in the future, which would make all that follow old."""
    return bool(np.isfinite(stamp) and stamp <= now_s + _AHEAD_S and not stamp <= known)
