"""The pelvis' IMU of a simulated robot: attitude, angular velocity and specific force where the real one sits."""

from __future__ import annotations

import math
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from hotice.model import g1
from hotice.model.frames import GRAVITY

Array = NDArray[np.float64]
SITE = "imu_in_pelvis"
UP = np.array([0.0, 0.0, 1.0])


class Inertial(NamedTuple):
    """One reading, in the IMU's axes, which are the pelvis' (x forward, y left, z up)."""

    quaternion: Array
    """(4,) wxyz, of the IMU in a level frame."""
    gyroscope: Array
    """(3,) [rad/s]"""
    accelerometer: Array
    """(3,) specific force [m/s²]: at rest +9.81 along what is up."""


class Imu:
    """Reads a robot with a free base. The specific force is the mean of the physics step just made."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self._p_PI = model.site(SITE).pos.copy()
        self._dt_s = model.opt.timestep
        self._velocity: Array | None = None

    def read(self, qpos: Array, qvel: Array) -> Inertial:
        """A reading after a physics step; the first one of all is that of a robot at rest."""
        quat, rate_P = qpos[g1.ROOT_QUAT], qvel[g1.ROOT_RATE]
        velocity = qvel[g1.ROOT_VEL] + rotated(quat, np.array(_cross(rate_P, self._p_PI)))
        before = velocity if self._velocity is None else self._velocity
        self._velocity = velocity
        force_W = (velocity - before) / self._dt_s + GRAVITY * UP
        return Inertial(quat.copy(), rate_P.copy(), rotated(conjugate(quat), force_W))


def rotated(quat: Array, vector: Array) -> Array:
    """`frames.quat_rotate` of one vector, (4,), (3,) -> (3,): MuJoCo's, a tenth of the time."""
    out = np.empty(3)
    mujoco.mju_rotVecQuat(out, vector, quat)
    return out


def conjugate(quat: Array) -> Array:
    """`frames.quat_conj` of one quaternion, (4,)."""
    out = np.empty(4)
    mujoco.mju_negQuat(out, quat)
    return out


def product(one: Array, other: Array) -> Array:
    """`frames.quat_mul` of two quaternions, (4,)."""
    out = np.empty(4)
    mujoco.mju_mulQuat(out, one, other)
    return out


def tilted(quat_WP: Array, gravity_P: Array) -> Array:
    """The attitude nearest to a given one, (4,), in which gravity points along `gravity_P` (3,), of any length."""
    wished = gravity_P / math.sqrt(gravity_P @ gravity_P)
    now = rotated(conjugate(quat_WP), -UP)
    turn = np.array([1.0 + now @ wished, *_cross(wished, now)])
    mujoco.mju_normalize4(turn)
    return product(quat_WP, turn)


def _cross(a: Array, b: Array) -> tuple[float, float, float]:
    (a0, a1, a2), (b0, b1, b2) = a.tolist(), b.tolist()
    return a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0


def roll_pitch_yaw(quat: Array) -> Array:
    """Angles of z-y-x rotations, (4,) -> (3,) [rad]."""
    w, x, y, z = quat.tolist()
    return np.array(
        [
            math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y)),
            math.asin(min(max(2.0 * (w * y - z * x), -1.0), 1.0)),
            math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)),
        ]
    )
