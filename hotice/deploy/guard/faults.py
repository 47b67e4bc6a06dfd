"""The fault table: one small function per row, from a measured number to a reaction. Pure; limits come from outside."""

from __future__ import annotations

import math
from enum import IntEnum
from typing import NamedTuple

import numpy as np

from hotice.deploy.guard.limits import GuardLimits


class Reaction(IntEnum):
    """What a fault makes the guard do, mildest first; of several the last counts."""

    NONE = 0
    WARN = 1
    """Told, nothing else."""
    HOLD = 2
    """A walking robot stands on the spot."""
    LOWER = 3
    """It puts the box down; no new carry."""
    DAMPING = 4


class Cause(IntEnum):
    """Why the guard is in its mode; numbers as in the slot's status."""

    NONE = 0
    OPERATOR = 1
    DONE = 2
    """The runner says that the goal is reached."""
    STATE_AGE = 3
    STATES_REFUSED = 4
    TARGET_AGE = 5
    TARGETS_REFUSED = 6
    LEAN = 7
    JOINT_SPEED = 8
    GYRO = 9
    HEAT = 10
    BATTERY = 11
    MOTOR = 12
    BOX_UNSEEN = 13
    POSE_AGE = 14
    POSE_DISPUTED = 15
    GAMEPAD = 16
    PUBLISHER = 17
    LINK = 18
    FALLING = 19


class Finding(NamedTuple):
    """A fault that is there now."""

    cause: Cause
    reaction: Reaction
    text: str
    value: float | int | str = ""
    """Stands for the braces of the text."""

    def __str__(self) -> str:
        return self.text.format(self.value)


def state_age(age_s: float, limits: GuardLimits) -> Reaction:
    """No LowState, a tick that stands still, damaged states only: all of them age [s]."""
    return _graded(age_s, (limits.state_warn_s, Reaction.WARN), (limits.state_s, Reaction.DAMPING))


def states_refused(in_a_row: int, limits: GuardLimits) -> Reaction:
    """Bad checksum, wrong machine, impossible numbers: one is dropped, several in a row are silence."""
    return _graded(in_a_row, (0, Reaction.WARN), (limits.refused_states - 1, Reaction.DAMPING))


def target_age(age_s: float, limits: GuardLimits) -> Reaction:
    """No fresh target of the runner for so long [s]."""
    return _graded(age_s, (limits.target_repeat_s, Reaction.WARN), (limits.target_s, Reaction.DAMPING))


def targets_refused(in_a_row: int, limits: GuardLimits) -> Reaction:
    """Targets that cannot be followed: see `hotice.deploy.guard.targets`."""
    return _graded(in_a_row, (0, Reaction.WARN), (limits.refused_targets - 1, Reaction.DAMPING))


def lean(quaternion: np.ndarray, limits: GuardLimits) -> Reaction:
    """Attitude (4,) wxyz of the pelvis, of length about 1, either sign: how far its axis is from upright."""
    w, x, y, z = quaternion.tolist()
    length = w * w + x * x + y * y + z * z
    up = 1.0 - 2.0 * (x * x + y * y) / length if length else math.nan
    return _graded(
        math.acos(min(max(up, -1.0), 1.0)) if math.isfinite(up) else math.nan, (limits.lean_rad, Reaction.DAMPING)
    )


def falling(lasted_s: float, limits: GuardLimits) -> Reaction:
    """How long the lean ahead has been beyond `falling_rad` [s]; minus infinity: it is not."""
    return Reaction.DAMPING if lasted_s >= limits.falling_s else Reaction.NONE


def joint_speed(dq: np.ndarray, limits: GuardLimits) -> Reaction:
    """Measured joint speeds (29,) [rad/s]."""
    return _graded(float(np.abs(dq).max()), (limits.joint_rad_s, Reaction.DAMPING))


def gyro(w_WP_P: np.ndarray, limits: GuardLimits) -> Reaction:
    """Angular velocity (3,) of the pelvis [rad/s]."""
    return _graded(float(np.abs(w_WP_P).max()), (limits.gyro_rad_s, Reaction.DAMPING))


def hot(casing_winding_c: np.ndarray, limits: GuardLimits) -> bool:
    """Whether any of temperatures (29, 2), casing and winding [°C], is too high."""
    return bool((casing_winding_c > (limits.casing_c, limits.winding_c)).any())


def empty(charge_percent: float | None, limits: GuardLimits) -> bool:
    """Whether the charge is known and too low."""
    return charge_percent is not None and charge_percent < limits.battery_percent


def lasting(lasted_s: float, limits: GuardLimits) -> Reaction:
    """Heat, a low charge or a motor's error that has lasted so long [s]; minus infinity: it is not there."""
    return _graded(lasted_s, (-np.inf, Reaction.WARN), (limits.lasting_s, Reaction.LOWER))


def box_unseen(age_s: float, limits: GuardLimits) -> Reaction:
    """Time since the box was last seen [s]; until then the estimator holds it in the pelvis' frame."""
    return _graded(age_s, (limits.box_s, Reaction.HOLD))


def pose_age(age_s: float, limits: GuardLimits) -> Reaction:
    """Age of the localization [s]; until then the estimator tracks on."""
    return _graded(age_s, (limits.pose_s, Reaction.HOLD))


def gamepad(without_s: float, limits: GuardLimits) -> Reaction:
    """Time without gamepad [s]."""
    return _graded(without_s, (limits.gamepad_s, Reaction.HOLD))


def _graded(value: float, *steps: tuple[float, Reaction]) -> Reaction:
    # not a number is beyond every limit
    return max((reaction for limit, reaction in steps if not value <= limit), default=Reaction.NONE)
