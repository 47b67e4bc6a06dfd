"""Judgements as plain loops over numbers, which a station compiles; a robot's guard asks `lean_ahead` as it is.

(Compiled by `hotice.compiled`.) Each `find_…` writes into `begun` (faults,) when the cause of a fault that is there now
began [s]; `begun` holds inf where there is none. Limits come as the arrays of `measurement_array`, …
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from hotice.safety.faults import Answer, Fault
from hotice.safety.limits import AgeLimits, CommandLimits, MeasurementLimits

Array = NDArray[np.float64]
_BOX_LATE, _BOX_INVALID = int(Fault.BOX_LATE), int(Fault.BOX_INVALID)
_POSE_LATE, _POSE_INVALID = int(Fault.POSE_LATE), int(Fault.POSE_INVALID)
_JOINT_LIMIT, _COMMAND_LATE = int(Fault.JOINT_LIMIT), int(Fault.COMMAND_LATE)
_COMMAND_STEP, _COMMAND_RANGE = int(Fault.COMMAND_STEP), int(Fault.COMMAND_RANGE)
_COMMAND_NOT_FINITE, _STATE_LATE = int(Fault.COMMAND_NOT_FINITE), int(Fault.STATE_LATE)
_STATE_FROZEN, _STATE_MISSING = int(Fault.STATE_FROZEN), int(Fault.STATE_MISSING)
_STATE_IMPOSSIBLE, _QUATERNION = int(Fault.STATE_IMPOSSIBLE), int(Fault.QUATERNION)
_STATE_NOT_FINITE, _JOINT_SPEED = int(Fault.STATE_NOT_FINITE), int(Fault.JOINT_SPEED)
_FALLING = int(Fault.FALLING)
_GYRO, _PELVIS_LOW, _TILT = int(Fault.GYRO), int(Fault.PELVIS_LOW), int(Fault.TILT)
_HOLD, _DAMP = int(Answer.HOLD), int(Answer.DAMP)
STILL_GYRO_RAD_S, STILL_JOINT_RAD_S, STILL_UP = 0.3, 0.5, 0.95
"""A robot that stands still: largest rates of pelvis and joints, least cosine of its lean (18 degrees; ours)."""
MOVING_RAD_S = 0.01
"""From this joint speed on a robot's numbers cannot stay the same."""
_SOON = 1e-9
"""Times closer than this are equal [s]."""


def measurement_array(limits: MeasurementLimits) -> Array:
    """Limits in the order in which `find_state` and `find_pose` read them."""
    return np.array(
        [
            limits.quaternion_tolerance,
            math.cos(limits.tilt_rad),
            limits.gyro_rad_s,
            limits.joint_speed_rad_s,
            limits.possible_speed_rad_s,
            limits.joint_margin_rad,
            limits.possible_margin_rad,
            limits.lowest_pelvis_m,
            limits.highest_pelvis_m,
            limits.box_reach_m,
            limits.falling_rad,
        ]
    )


def command_array(limits: CommandLimits) -> Array:
    """Limits in the order in which `find_command` reads them: those of joint targets."""
    return np.array([limits.target_margin_rad, limits.step_rad])


def age_array(limits: AgeLimits) -> Array:
    """Limits in the order in which `find_ages` reads them."""
    return np.array([limits.state_s, limits.command_s, limits.pose_s, limits.box_s])


def all_finite(vector) -> bool:
    """Whether no number of a vector (n,) is infinite or none."""
    for value in vector:
        if not math.isfinite(value):
            return False
    return True


def find_state(begun, now, quat, gyro, q, qd, lower, upper, limits):
    """Faults of what the robot measures of itself.

    `quat` (4,) wxyz; `gyro` (3,) [rad/s]; `q`, `qd` (n,) [rad, rad/s]; `lower`, `upper` (n,): ranges [rad].
    """
    finite, possible, beyond, fast, turning = True, True, False, False, False
    for i in range(len(q)):
        if not (math.isfinite(q[i]) and math.isfinite(qd[i])):
            finite = False
        else:
            out = max(q[i] - upper[i], lower[i] - q[i])
            if out > limits[6] or abs(qd[i]) > limits[4]:
                possible = False
            beyond = beyond or out > limits[5]
            fast = fast or abs(qd[i]) > limits[3]
    for i in range(3):
        if not math.isfinite(gyro[i]):
            finite = False
        elif abs(gyro[i]) > limits[4]:
            possible = False
        else:
            turning = turning or abs(gyro[i]) > limits[2]
    length2 = quat[0] * quat[0] + quat[1] * quat[1] + quat[2] * quat[2] + quat[3] * quat[3]
    if not finite or not math.isfinite(quat[0] + quat[1] + quat[2] + quat[3]):
        begun[_STATE_NOT_FINITE] = now
    elif not possible:
        begun[_STATE_IMPOSSIBLE] = now
    if math.isfinite(length2) and abs(math.sqrt(length2) - 1.0) <= limits[0]:
        if length2 - 2.0 * (quat[1] * quat[1] + quat[2] * quat[2]) < limits[1] * length2:
            begun[_TILT] = now
    elif not math.isnan(length2):
        begun[_QUATERNION] = now
    if possible:
        if fast:
            begun[_JOINT_SPEED] = now
        if turning:
            begun[_GYRO] = now
        if beyond:
            begun[_JOINT_LIMIT] = now


def lean_ahead(quat, gyro, ahead_s):
    """Lean of the pelvis `ahead_s` from now at its present rate [rad], of a quaternion (4,) wxyz near unit length.

    The lean is the angle between its z axis and the vertical; `gyro` (3,) [rad/s] in P says how fast it grows.
    """
    w, x, y, z = quat
    # the vertical in P
    ux, uy, uz = 2.0 * (x * z - w * y), 2.0 * (y * z + w * x), w * w - x * x - y * y + z * z
    level = math.sqrt(ux * ux + uy * uy)
    if level < 1e-9:
        rate = math.sqrt(gyro[0] * gyro[0] + gyro[1] * gyro[1])
    else:
        rate = (uy * gyro[0] - ux * gyro[1]) / level
    return math.atan2(level, uz) + ahead_s * rate


def find_falling(begun, now, ahead_rad, limits):
    """The fault of a pelvis whose `lean_ahead` [rad] is too large; after `find_state`, which judged the measurement."""
    unsound = min(begun[_STATE_NOT_FINITE], begun[_STATE_IMPOSSIBLE], begun[_QUATERNION])
    if ahead_rad > limits[10] and not math.isfinite(unsound):
        begun[_FALLING] = now


def find_pose(begun, now, p_WP, p_WO, R_WO, limits):
    """Faults of what is known of places: pelvis and object (3,) [m], the object's rotation (9,), row by row."""
    height = p_WP[2]
    placed = math.isfinite(p_WP[0]) and math.isfinite(p_WP[1]) and math.isfinite(height)
    if not placed or height < 0.0 or height > limits[8]:
        begun[_POSE_INVALID] = now
    elif height < limits[7]:
        begun[_PELVIS_LOW] = now
    apart2 = 0.0
    for i in range(3):
        # NaN fails every comparison; a pelvis that is nowhere says nothing against the object
        apart = p_WO[i] - p_WP[i] if placed else 0.0 * p_WO[i]
        apart2 += apart * apart
        length2 = R_WO[i] * R_WO[i] + R_WO[i + 3] * R_WO[i + 3] + R_WO[i + 6] * R_WO[i + 6]
        if not abs(math.sqrt(length2) - 1.0) <= limits[0]:
            begun[_BOX_INVALID] = now
    if not apart2 <= limits[9] * limits[9]:
        begun[_BOX_INVALID] = now


def find_command(begun, now, command, last, lower, upper, limits, targets):
    """Faults of a command (n,) after the `last` valid one (n,).

    `targets`: joint targets [rad] within `lower` and `upper` with a margin, stepping no further than a limit from the
    last one (NaN: there is none); else torques [N m] within `lower` and `upper`.
    """
    margin = limits[0] if targets else 0.0
    for i in range(len(command)):
        if not math.isfinite(command[i]):
            begun[_COMMAND_NOT_FINITE] = now
        elif command[i] > upper[i] + margin or command[i] < lower[i] - margin:
            begun[_COMMAND_RANGE] = now
        elif targets and abs(command[i] - last[i]) > limits[1]:
            begun[_COMMAND_STEP] = now


def find_ages(begun, now, stamps, before, same, limits):
    """Faults of age.

    Args:
        begun, now: see above.
        stamps: (4,) when state, command, pose and object pose were made [s]; NaN: never.
        before: (4,) the stamps of the check before.
        same: since when the state's numbers stand still though they should not [s]; inf: they move.
        limits: (4,) ages from which each is late [s]. What is as far ahead of now was never made: its clock is wrong.
    """
    if not (math.isfinite(stamps[0]) and stamps[0] - now < limits[0]):
        begun[_STATE_MISSING] = now
    elif now - stamps[0] >= limits[0] - _SOON:
        begun[_STATE_FROZEN if stamps[0] == before[0] else _STATE_LATE] = stamps[0]
    if now - same >= limits[0] - _SOON:
        begun[_STATE_FROZEN] = min(same, begun[_STATE_FROZEN])
    # never made: late since whenever the fault is first seen
    if not abs(now - stamps[1]) < limits[1] - _SOON:
        begun[_COMMAND_LATE] = stamps[1] if math.isfinite(stamps[1]) and stamps[1] < now else now
    if not abs(now - stamps[2]) < limits[2] - _SOON:
        begun[_POSE_LATE] = stamps[2] if math.isfinite(stamps[2]) and stamps[2] < now else now
    if not abs(now - stamps[3]) < limits[3] - _SOON:
        begun[_BOX_LATE] = stamps[3] if math.isfinite(stamps[3]) and stamps[3] < now else now


def stands_still(quat, gyro, qd):
    """Whether a robot stands still and upright, so that its posture may be held without falling like a board."""
    for rate in gyro:
        if not abs(rate) <= STILL_GYRO_RAD_S:
            return False
    for rate in qd:
        if not abs(rate) <= STILL_JOINT_RAD_S:
            return False
    return 1.0 - 2.0 * (quat[1] * quat[1] + quat[2] * quat[2]) >= STILL_UP


def remember(begun, now, since, counts):
    """Keeps in `since` (faults,) [s] when each present fault began, inf for others, and adds one to its count.

    A cause that says that it began before now is believed: what comes late but regularly grows no older.
    """
    for fault in range(1, len(begun)):
        if math.isfinite(begun[fault]):
            since[fault] = begun[fault] if begun[fault] < now else min(since[fault], now)
            counts[fault] += 1
        else:
            since[fault] = math.inf


def decide(now, since, still, responses, still_holds):
    """The strongest answer to all present faults, and the worst fault that asks for it; `0, 0`: there is none.

    `since` as `remember` keeps it; `still`: the robot stands still; the tables of `hotice.safety.responses`.
    """
    answer, cause = 0, 0
    for fault in range(1, len(since)):
        lasted = now - since[fault]
        if lasted < -_SOON:
            continue
        asked = 0
        for a in range(responses.shape[1]):
            if lasted >= responses[fault, a] - _SOON:
                asked = a
        if asked == _DAMP and still and still_holds[fault]:
            asked = _HOLD
        if asked >= answer:
            answer, cause = asked, fault
    return answer, cause
