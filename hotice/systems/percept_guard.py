"""Percepts in which what is lost or cannot be is replaced: object and pelvis by where they are without it."""

# pydrake's stubs type arrays as numpy does not:
# pyright: reportArgumentType=false, reportCallIssue=false, reportIndexIssue=false, reportReturnType=false

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context, LeafSystem, State, ValueProducer

from hotice.compiled import compiled
from hotice.model.carry import CarryState
from hotice.model.robot_state import RobotState
from hotice.policy.legs import Legs
from hotice.policy.measuring import attitude
from hotice.policy.percept import Percept, PerceptModel
from hotice.safety import Fault, MeasurementLimits, judge
from hotice.safety.jumps import GATE, NEAR, POSE, REFUSED, empty_gate, jump_array, jump_limits, pass_gate
from hotice.systems.signals import PERCEPT, SOURCES, STAMPS
from hotice.task.sensing import TRACK_TILT, SensingConfig

Array = NDArray[np.float64]
_GOOD, _BOX, _PLACE = slice(0, PERCEPT), slice(PERCEPT, PERCEPT + GATE), slice(PERCEPT + GATE, PERCEPT + 2 * GATE)
_STAMPS = slice(_PLACE.stop, _PLACE.stop + STAMPS)
_DOWN = slice(_STAMPS.stop, _STAMPS.stop + 3)
_COUNT, _FOOT = _DOWN.stop, _DOWN.stop + 1
_SIZE = _FOOT + 1
_P_WP, _YAW, _GRAVITY, _GYRO, _P_WK, _P_WO, _R_WO, _P_WOK = (
    Percept.PARTS[name] for name in ("p_WP", "yaw", "gravity_P", "w_WP_P", "p_WK", "p_WO", "R_WO", "p_WOK")
)
_HEADING = _YAW.start
_NONE, _BOX_INVALID, _BOX_JUMP = int(Fault.NONE), int(Fault.BOX_INVALID), int(Fault.BOX_JUMP)
_POSE_INVALID, _POSE_JUMP, _PELVIS_LOW = int(Fault.POSE_INVALID), int(Fault.POSE_JUMP), int(Fault.PELVIS_LOW)
_FAULTS, _REFUSED, _NEAR = len(Fault), REFUSED, NEAR
_AHEAD_S = 1e-6
"""Rounding of times."""
_find_pose, _pass_gate = compiled(judge.find_pose), compiled(pass_gate)
_finite = compiled(judge.all_finite)


@compiled
def track_down(down_P, count, gravity_P, w_WP_P, dt_s):
    """`hotice.policy.measuring.track_gravity` in loops, its first measurements averaged; keeps in `down_P` (3,)."""
    gain = max(TRACK_TILT, 1.0 / (count + 1.0))
    new, length2 = np.empty(3), 0.0
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        turned = down_P[i] + dt_s * (down_P[j] * w_WP_P[k] - down_P[k] * w_WP_P[j]) if count else gravity_P[i]
        new[i] = turned + gain * (gravity_P[i] - turned)
        length2 += new[i] * new[i]
    # what is not finite, or no direction, is not taken
    if not (0.0 < length2 < math.inf):
        return count
    for i in range(3):
        down_P[i] = new[i] / math.sqrt(length2)
    return count + 1.0


@compiled
def attitude_of(yaw, down_P, R_WP):
    """`hotice.policy.measuring.attitude` in loops, into `R_WP` (3, 3)."""
    along, across, up = -down_P[0], -down_P[1], -down_P[2]
    level = math.sqrt(across * across + up * up)
    c, s = math.cos(yaw), math.sin(yaw)
    rows = (
        (level, -along * across / level, -along * up / level),
        (0.0, up / level, -across / level),
    )
    for i in range(3):
        R_WP[0, i] = c * rows[0][i] - s * rows[1][i]
        R_WP[1, i] = s * rows[0][i] + c * rows[1][i]
    R_WP[2, 0], R_WP[2, 1], R_WP[2, 2] = along, across, up


@compiled
def _flat(p_WP, yaw, pose):
    """Writes into `pose` (12,) how gates compare places: roll and pitch are the IMU's, and do not count."""
    for i in range(3):
        pose[i] = p_WP[i]
    for i in range(3, POSE):
        pose[i] = 0.0
    pose[3] = pose[7] = math.cos(yaw)
    pose[6], pose[4], pose[11] = math.sin(yaw), -math.sin(yaw), 1.0


@compiled
def _look(now, dt_s, percept, stamps, memory, limits, place_jump, box_jump, lowest_m):
    """Faults of pelvis and object, whether each pose is taken over, and the heading by gyro [rad]; keeps the memory.

    Returns numbers; see `PerceptGuard`.
    """
    found, known = np.full(_FAULTS, np.inf), memory[_STAMPS]
    p_WP, p_WO, R_WO, yaw = percept[_P_WP], percept[_P_WO], percept[_R_WO], percept[_HEADING]
    _find_pose(found, 0.0, p_WP, p_WO, R_WO, limits)
    down, gyro = memory[_DOWN], percept[_GYRO]
    memory[_COUNT] = track_down(down, memory[_COUNT], percept[_GRAVITY], gyro, dt_s)
    turned = memory[_HEADING] - dt_s * (down[0] * gyro[0] + down[1] * gyro[1] + down[2] * gyro[2])
    place, box, pose = _NONE, _NONE, np.zeros(POSE)
    # a pose of the future is none: all that follow would be old; one that is asked for again is what it was; a clock
    # that was set back makes all that is known one of the future
    new, took = np.zeros(2, np.bool_), np.zeros(2, np.bool_)
    for i in range(2):
        new[i] = stamps[i] <= now + _AHEAD_S and (not stamps[i] <= known[i] or known[i] > now + _AHEAD_S)
        took[i] = stamps[i] == known[i] and stamps[i] == now
    if new[0]:
        gate = memory[_PLACE]
        _flat(memory[_P_WP], turned, gate)
        _flat(p_WP, yaw, pose)
        if math.isfinite(found[_POSE_INVALID]) or not (_finite(percept[_P_WK]) and math.isfinite(yaw)):
            place = _POSE_INVALID
        else:
            said = _pass_gate(gate, pose, place_jump)
            if said != _NEAR:
                place = _PELVIS_LOW if said != _REFUSED and p_WP[2] < lowest_m else _POSE_JUMP
        took[0] = place == _NONE
    if new[1] and place == _NONE:
        R_WP = np.empty((3, 3))
        attitude_of(yaw, down, R_WP)
        for i in range(3):
            pose[i] = 0.0
            for k in range(3):
                pose[i] += R_WP[k, i] * (p_WO[k] - p_WP[k])
                pose[3 + 3 * i + k] = R_WP[0, i] * R_WO[k] + R_WP[1, i] * R_WO[3 + k] + R_WP[2, i] * R_WO[6 + k]
        if math.isfinite(found[_BOX_INVALID]) or not (_finite(percept[_P_WOK]) and _finite(pose)):
            box = _BOX_INVALID
        elif _pass_gate(memory[_BOX], pose, box_jump) == _REFUSED:
            box = _BOX_JUMP
        took[1] = box == _NONE
    for i in range(2):
        if took[i]:
            known[i] = stamps[i]
    return place, box, took[0], took[1], turned


class PerceptGuard(LeafSystem):
    """Inputs `percept` (119,), `stamps` (2,). Outputs `percept` (119,), `sources` (4,), see `signals`.

    `stamps`: when the poses of pelvis and object in the percept were made [s]. An object's pose that is old, none, far
    from the pelvis or a jump is replaced by the last accepted one in the pelvis frame, where a carried object hardly
    moves; five jumps in a row that agree are the truth. A pelvis' pose that is old, none or a jump is replaced by where
    legs and gyro carried the last accepted one. Its jumps are never believed, however many agree: nobody is there to
    say which is right, and a turn that the gyro did not feel was none. Five that agree on a fallen pelvis are a fall.

    Args:
        carry: how the object is carried, and the wrists.
        control_dt_s: period of the percepts.
        sensing: noise that percepts may have, which is no jump.
    """

    def __init__(self, carry: CarryState, control_dt_s: float, sensing: SensingConfig | None = None) -> None:
        super().__init__()
        carried, self._dt_s = carry.carried, control_dt_s
        self._legs = Legs(PerceptModel(carried), RobotState.from_carry(carry).to_mujoco(29)[0])
        self._p_OK, self._aligned = carried.keypoints(), carried.keypoints_world_aligned
        measurement = MeasurementLimits()
        place, box = jump_limits(sensing or SensingConfig())
        self._limits = judge.measurement_array(measurement), jump_array(place), jump_array(box)
        self._lowest_m = measurement.lowest_pelvis_m
        start = np.full(_SIZE, np.nan)
        start[_BOX] = start[_PLACE] = empty_gate()
        start[_COUNT] = 0.0
        self.DeclareDiscreteState(start)
        self._percept = self.DeclareVectorInputPort("percept", PERCEPT)
        self._stamps = self.DeclareVectorInputPort("stamps", STAMPS)
        guarded = ValueProducer(lambda: AbstractValue.Make(object()), self._guard)
        self._guarded = self.DeclareCacheEntry("percept, sources and memory from now on", guarded)
        self.DeclareVectorOutputPort("percept", PERCEPT, self._output_percept)
        self.DeclareVectorOutputPort("sources", SOURCES, self._output_sources)
        self.DeclarePeriodicUnrestrictedUpdateEvent(control_dt_s, 0.0, self._update)

    def _output_percept(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._guarded.Eval(context)[0])

    def _output_sources(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._guarded.Eval(context)[1])

    def _update(self, context: Context, state: State) -> None:
        state.get_mutable_discrete_state(0).SetFromVector(self._guarded.Eval(context)[2])

    def _guard(self, context: Context, value: AbstractValue) -> None:
        vector, stamps = self._percept.Eval(context).copy(), self._stamps.Eval(context)
        memory = context.get_discrete_state_vector().value().copy()
        place, box, placed, held, yaw = _look(
            context.get_time(), self._dt_s, vector, stamps, memory, *self._limits, self._lowest_m
        )
        if placed:
            memory[_FOOT] = np.nan
        elif not math.isnan(memory[0]):
            self._carry_on(Percept(vector), Percept(memory[_GOOD]), yaw, memory)
        if not (placed and held) and not math.isnan(memory[_BOX][0]):
            self._hold(Percept(vector), memory[_BOX][:POSE], memory[_DOWN])
        if math.isfinite(vector.dot(vector)):
            memory[_GOOD] = vector
        known = memory[_STAMPS]
        value.set_value((vector, np.array([known[0], known[1], place, box], dtype=float), memory))

    def _carry_on(self, percept: Percept, good: Percept, yaw: float, memory: Array) -> None:
        """Writes into a percept where legs and gyro carried the pelvis, and the keypoints there."""
        placed = self._legs.step(good.p_WP, good.p_WK, memory[_FOOT], yaw, memory[_DOWN], percept.q)
        percept.p_WP[:], percept.p_WK[:], memory[_FOOT] = placed
        percept.yaw[:] = yaw

    def _hold(self, percept: Percept, pose: Array, down_P: Array) -> None:
        """Writes the object's pose (12,) in the pelvis frame into a percept."""
        R_WP = attitude(float(percept.yaw[0]), down_P)
        percept.p_WO[:] = percept.p_WP + R_WP @ pose[:3]
        percept.R_WO[:] = R_WP @ pose[3:].reshape(3, 3)
        percept.p_WOK[:] = percept.p_WO + (self._p_OK if self._aligned else self._p_OK @ percept.R_WO.T)
