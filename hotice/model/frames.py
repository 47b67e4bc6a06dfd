"""Rotations as plain numpy, batched over any leading axes. Quaternions are wxyz and unit; `R_AB` maps B into A."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = [
    "GRAVITY",
    "mat_to_quat",
    "normalize",
    "quat_conj",
    "quat_from_axis_angle",
    "quat_from_yaw",
    "quat_mul",
    "quat_rotate",
    "quat_to_mat",
    "rotation_y",
    "rotation_z",
    "yaw_from_quat",
]

GRAVITY = 9.81
"""Along -z of the world [m/s²], as in every model that a simulator runs."""
Array = NDArray[np.float64]


def normalize(v: ArrayLike, eps: float = 1e-12) -> Array:
    """Scales the last axis to length one; vectors shorter than `eps` come back as they are (divided by `eps`)."""
    v = np.asarray(v, dtype=float)
    return v / np.maximum(np.linalg.norm(v, axis=-1, keepdims=True), eps)


def rotation_z(yaw_rad: float) -> Array:
    """Rotation matrix about z, (3, 3): R_AB of a frame B that heads `yaw_rad` to the left of A; of -yaw: R_BA."""
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def rotation_y(pitch_rad: float) -> Array:
    """Rotation matrix about y, (3, 3); positive leans forward."""
    c, s = math.cos(pitch_rad), math.sin(pitch_rad)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


def quat_mul(a: ArrayLike, b: ArrayLike) -> Array:
    """Hamilton product, (..., 4) x (..., 4) -> (..., 4): quat_AB times quat_BC is quat_AC."""
    a, b = np.asarray(a, dtype=float), np.asarray(b, dtype=float)
    aw, ax, ay, az = np.moveaxis(a, -1, 0)
    bw, bx, by, bz = np.moveaxis(b, -1, 0)
    return np.stack(
        [
            aw * bw - ax * bx - ay * by - az * bz,
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
        ],
        axis=-1,
    )


def quat_conj(q: ArrayLike) -> Array:
    """Inverse of unit quaternions, (..., 4) -> (..., 4)."""
    return np.asarray(q, dtype=float) * np.array([1.0, -1.0, -1.0, -1.0])


def quat_rotate(q: ArrayLike, v: ArrayLike) -> Array:
    """Rotates vectors: quat_AB (..., 4) and v_B (..., 3) give v_A (..., 3); leading axes broadcast."""
    q, v = np.asarray(q, dtype=float), np.asarray(v, dtype=float)
    w, u = q[..., :1], q[..., 1:]
    t = 2.0 * np.cross(u, v)
    return v + w * t + np.cross(u, t)


def quat_from_axis_angle(axis: ArrayLike, angle_rad: ArrayLike) -> Array:
    """Rotation by `angle_rad` (...) about `axis` (..., 3), which need not be of length one -> (..., 4)."""
    half = 0.5 * np.asarray(angle_rad, dtype=float)[..., None]
    xyz = np.sin(half) * normalize(axis)
    return np.concatenate([np.broadcast_to(np.cos(half), (*xyz.shape[:-1], 1)), xyz], axis=-1)


def quat_from_yaw(yaw_rad: ArrayLike) -> Array:
    """Rotation about z, (...) -> (..., 4)."""
    half = 0.5 * np.asarray(yaw_rad, dtype=float)
    zero = np.zeros_like(half)
    return np.stack([np.cos(half), zero, zero, np.sin(half)], axis=-1)


def yaw_from_quat(q: ArrayLike) -> Array:
    """Heading of the x axis, (..., 4) -> (...) [rad]; the yaw of z-y-x Euler angles."""
    w, x, y, z = np.moveaxis(np.asarray(q, dtype=float), -1, 0)
    return np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def quat_to_mat(q: ArrayLike) -> Array:
    """Rotation matrices, (..., 4) -> (..., 3, 3)."""
    w, x, y, z = np.moveaxis(np.asarray(q, dtype=float), -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def mat_to_quat(R: ArrayLike) -> Array:
    """Unit quaternions with w >= 0, (..., 3, 3) -> (..., 4). The best conditioned of four formulas is taken."""
    R = np.asarray(R, dtype=float)
    m00, m01, m02 = np.moveaxis(R[..., 0, :], -1, 0)
    m10, m11, m12 = np.moveaxis(R[..., 1, :], -1, 0)
    m20, m21, m22 = np.moveaxis(R[..., 2, :], -1, 0)
    candidates = np.stack(
        [
            np.stack([1 + m00 + m11 + m22, m21 - m12, m02 - m20, m10 - m01], axis=-1),
            np.stack([m21 - m12, 1 + m00 - m11 - m22, m01 + m10, m02 + m20], axis=-1),
            np.stack([m02 - m20, m01 + m10, 1 - m00 + m11 - m22, m12 + m21], axis=-1),
            np.stack([m10 - m01, m02 + m20, m12 + m21, 1 - m00 - m11 + m22], axis=-1),
        ],
        axis=-2,
    )
    best = np.argmax(np.diagonal(candidates, axis1=-2, axis2=-1), axis=-1)
    q = normalize(np.take_along_axis(candidates, best[..., None, None], axis=-2)[..., 0, :])
    return np.where(q[..., :1] < 0, -q, q)
