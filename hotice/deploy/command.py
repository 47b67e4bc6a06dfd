"""The only command a link sends: finite, inside the robot's limits of position, torque and gain, and not to be changed.

It bounds what a message may hold. What the motors then make of it, tau + kp (q − q_measured) + kd (dq − dq_measured),
depends on the measured state: `motor_torques` says how much, and the guard is to hold it to the limits.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from hotice import checks
from hotice.deploy.messages.checks import seal
from hotice.deploy.messages.hg import JOINTS, LOW_CMD, MACHINES, PITCH_ROLL
from hotice.errors import HoticeError
from hotice.model import g1
from hotice.model.joint_limits import position_limits, torque_limits
from hotice.safety.limits import DAMPING_KD, LARGEST_SPEED

FIELDS = ("q", "dq", "tau", "kp", "kd")


class UnsafeCommand(HoticeError):
    """A command with a number that is not finite or outside the robot's limits; names joint, value and range."""


class Limits(NamedTuple):
    """Bounds of a command, each (29,) float32 as in a message, read-only, in the order of `g1.ALL_JOINTS`."""

    lower: np.ndarray
    """[rad]"""
    upper: np.ndarray
    """[rad]"""
    torque: np.ndarray
    """[N m], of tau + kd dq, which is what a message asks of a motor that stands at its target"""
    kp: np.ndarray
    """The trained stiffness [N m/rad]; less is allowed."""
    kd: np.ndarray
    """The trained damping or `DAMPING_KD`, whichever is larger [N m s/rad]; less is allowed."""


def _limits() -> Limits:
    kp, kd = g1.gains(g1.ALL_JOINTS)
    rows = (*position_limits(), torque_limits(), kp, np.maximum(kd, DAMPING_KD))
    # views of bytes: no flag makes them writable again
    return Limits(*(np.frombuffer(row.astype(np.float32).tobytes(), np.float32) for row in rows))


LIMITS = _limits()
_SHAPE = (len(g1.ALL_JOINTS),)
_NONE = np.zeros_like(LIMITS.kp)
_SPEED = np.full_like(LIMITS.kp, LARGEST_SPEED)
_LOWEST = np.stack([LIMITS.lower, -_SPEED, -LIMITS.torque, _NONE, _NONE, -LIMITS.torque])
_HIGHEST = np.stack([LIMITS.upper, _SPEED, LIMITS.torque, LIMITS.kp, LIMITS.kd, LIMITS.torque])
"""Bounds of q, dq, tau, kp, kd and tau + kd dq, (6, 29)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class CheckedCommand:
    """Targets, torques and gains of the 29 joints, each (29,) float32 and read-only. Raises `UnsafeCommand`."""

    q: np.ndarray
    """Target positions [rad]."""
    dq: np.ndarray
    """Target speeds [rad/s]."""
    tau: np.ndarray
    """Torques added to the servo's [N m]."""
    kp: np.ndarray
    """Stiffness [N m/rad]."""
    kd: np.ndarray
    """Damping [N m s/rad]."""
    enabled: np.ndarray
    """Mask of the motors that are on, (29,) bool."""

    def __post_init__(self) -> None:
        rows = np.empty(_LOWEST.shape, np.float32)
        with np.errstate(invalid="ignore", over="ignore"):
            for row, name in zip(rows, FIELDS, strict=False):
                row[:] = _numbers(name, getattr(self, name))
            rows[5] = rows[2] + rows[4] * rows[1]
        # views of bytes: no flag makes them writable again
        for row, name in zip(np.frombuffer(rows.tobytes(), np.float32).reshape(rows.shape), FIELDS, strict=False):
            object.__setattr__(self, name, row)
        object.__setattr__(self, "enabled", _mask(self.enabled))
        # one comparison for a good command, which there are 500 of a second; what is not is looked at one by one
        if not ((rows >= _LOWEST) & (rows <= _HIGHEST)).all():
            self._refuse()

    def _refuse(self) -> None:
        for name in FIELDS:
            _within(name, getattr(self, name), -np.inf, np.inf)
        _within("q", self.q, LIMITS.lower, LIMITS.upper)
        _within("dq", self.dq, -LARGEST_SPEED, LARGEST_SPEED)
        _within("kp", self.kp, 0.0, LIMITS.kp)
        _within("kd", self.kd, 0.0, LIMITS.kd)
        _within("tau", self.tau, -LIMITS.torque, LIMITS.torque)
        _within("tau + kd dq", self.tau + self.kd * self.dq, -LIMITS.torque, LIMITS.torque)

    def motor_torques(self, q: ArrayLike, dq: ArrayLike) -> np.ndarray:
        """Torques of the motors at measured positions [rad] and speeds [rad/s], (29,) [N m]; 0 where off."""
        torque = self.tau + self.kp * (self.q - np.asarray(q)) + self.kd * (self.dq - np.asarray(dq))
        return np.where(self.enabled, torque, 0.0)

    def record(self, mode_machine: int) -> np.ndarray:
        """As a LowCmd () for the machine that the robot says it is; ankles and waist by pitch and roll.

        Raises:
            UnsafeCommand: there is no such machine
        """
        # a list: a record's field may be an array (), which has no hash
        if mode_machine not in list(MACHINES):
            raise UnsafeCommand(
                f"mode_machine of a command is {checks.shown(mode_machine)}: known are "
                f"{', '.join(map(str, MACHINES))}; take it from the robot's state"
            )
        command = LOW_CMD.zeros()
        command["mode_pr"], command["mode_machine"] = PITCH_ROLL, mode_machine
        motors = command["motor_cmd"]
        motors["mode"][JOINTS] = self.enabled
        for name in FIELDS:
            motors[name][JOINTS] = getattr(self, name)
        return command

    def message(self, mode_machine: int) -> bytes:
        """As bytes on the wire, checksum in place. Raises `UnsafeCommand` as `record` does."""
        return seal(LOW_CMD, self.record(mode_machine))


def _numbers(name: str, values: ArrayLike) -> np.ndarray:
    array = _row(name, values)
    if array.dtype.kind not in "fiu":
        raise UnsafeCommand(f"{name} of a command is of {array.dtype}: real numbers are needed")
    return array


def _mask(values: ArrayLike) -> np.ndarray:
    array = _row("enabled", values)
    if array.dtype != np.bool_:
        raise UnsafeCommand(f"enabled of a command is of {array.dtype}: bool is needed")
    # what cannot be changed by anybody, a view of bytes, is taken as it is
    return array if type(array.base) is bytes else np.frombuffer(array.tobytes(), np.bool_)


def _row(name: str, values: ArrayLike) -> np.ndarray:
    array = np.asarray(values)
    if array.shape != _SHAPE:
        raise UnsafeCommand(f"{name} of a command has shape {array.shape}: ({_SHAPE[0]},) is needed, one a joint")
    return array


def _within(name: str, values: np.ndarray, low: ArrayLike, high: ArrayLike) -> None:
    good = np.isfinite(values) & (values >= low) & (values <= high)
    if not good.all():
        i = int(np.argmin(good))
        low_i, high_i = (float(np.broadcast_to(bound, values.shape)[i]) for bound in (low, high))
        allowed = "finite numbers are" if np.isinf(high_i) else f"{low_i:.4g} to {high_i:.4g} is"
        raise UnsafeCommand(f"{g1.ALL_JOINTS[i]}: {name} = {values[i]:.6g} in a command: {allowed} allowed")
