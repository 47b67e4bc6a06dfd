"""Measuring: noise on a percept, and the root, gravity and object that are tracked behind it.

One robot, all in numpy: `hotice.systems.sensor_model` measures so in a diagram, and a robot tracks with the same
functions. The numbers and rules are in `hotice.task.sensing`.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from hotice.model.frames import quat_from_axis_angle, quat_to_mat, rotation_z
from hotice.policy.percept import Percept
from hotice.task.sensing import TRACK_HEADING, TRACK_PLACE, TRACK_VELOCITY, SensingConfig

Array = NDArray[np.float64]
DRAWS = 56
"""Uniform numbers a measurement takes: heading 1, place 3, gyro 3, gravity 3, joint angles 20, object 3 + 3, joint
velocities 20."""
ESTIMATE = 20
"""Numbers of an estimate: the root's x, y, z [m], sine and cosine of its heading, its tracked velocity [m/s], the
direction of gravity in P, then of the object in P its position [m] and first two axes."""
_PLACE, _VELOCITY, _DOWN, _OBJECT = slice(0, 3), slice(5, 8), slice(8, 11), slice(11, 20)


def measure(
    true: Percept,
    estimate: Array,
    draws: Array,
    config: SensingConfig,
    world_aligned: bool,
    joint_offset: Array | float = 0.0,
    *,
    keypoints: Callable[[Array], Array] | None = None,
    refresh: bool = True,
    gain: float = 1.0,
    tilt_gain: float = 1.0,
    hold_s: float = 0.0,
    dt_s: float = 0.0,
) -> tuple[Percept, Array]:
    """A measurement of a true percept, and the estimate of root and object behind it.

    Args:
        true: the percept without noise.
        estimate: (20,) the last one, see `ESTIMATE`.
        draws: (56,) uniform numbers in [-1, 1).
        config: half widths of the noise.
        world_aligned: keypoints of the object keep world directions (spheres).
        joint_offset: (20,) error of the encoders [rad].
        keypoints: gives those of the robot (11, 3), its root where it truly is, for measured joints (20,); None: the
            true ones.
        refresh: whether the root's place is measured anew.
        gain: weight of the newest pose of the object; 1 forgets all others.
        tilt_gain: the same of the direction of gravity.
        hold_s, dt_s: time between refreshes and since the last measurement [s], which tracking needs; 0 at the first.
    """
    u_yaw, u_root, u_gyro, u_gravity, u_q, u_pos, u_rot, u_qd = np.split(draws, [1, 4, 7, 10, 30, 33, 36])
    gravity_P, w_WP_P = true.gravity_P + config.gravity * u_gravity, true.w_WP_P + config.gyro_rad_s * u_gyro
    seen = np.concatenate([true.p_WP + config.root_pos_m * u_root, true.yaw + config.root_yaw_rad * u_yaw])
    down_P = gravity_P
    if config.gravity or config.gyro_rad_s:
        down_P = track_gravity(estimate[_DOWN], gravity_P, w_WP_P, tilt_gain, dt_s)
    if config.root_tracking and dt_s:
        root = track_root(estimate[: _DOWN.start], seen if refresh else None, -float(down_P @ w_WP_P), hold_s, dt_s)
    elif refresh:
        root = root_at(seen)
    else:
        root = estimate[: _DOWN.start]
    p_WP = root[_PLACE].copy()
    yaw = heading(root)
    R_WP = attitude(true.yaw[0], true.gravity_P)
    R_EW = attitude(yaw[0], down_P) @ R_WP.T  # into the estimated world frame
    q = true.q + joint_offset + config.joint_pos_rad * u_q
    p_WK = true.p_WK if keypoints is None else keypoints(q)
    p_PO = true.p_WO - true.p_WP + config.object_pos_m * u_pos
    tilt = config.object_rot_rad * u_rot
    R_tilt = quat_to_mat(quat_from_axis_angle(tilt, np.linalg.norm(tilt)))
    newest = np.vstack([p_PO, (R_tilt @ true.R_WO)[:, :2].T]) @ R_WP
    seen_object = newest if gain >= 1.0 else blend(estimate[_OBJECT].reshape(3, 3), newest, gain)
    if gain < 1.0:
        p_PO, x, y = seen_object @ R_WP.T
        R_tilt = right_angled(x, y) @ true.R_WO.T
    p_WO = p_WP + R_EW @ p_PO
    arms = true.p_WOK - true.p_WO
    percept = Percept.of(
        p_WP=p_WP,
        yaw=yaw,
        gravity_P=gravity_P,
        w_WP_P=w_WP_P,
        q=q,
        qd=true.qd + config.joint_vel_rad_s * u_qd,
        p_WK=p_WP + (p_WK - true.p_WP) @ R_EW.T,
        p_WO=p_WO,
        R_WO=R_EW @ R_tilt @ true.R_WO,
        p_WOK=p_WO + (arms if world_aligned else arms @ (R_EW @ R_tilt).T),
    )
    return percept, np.concatenate([root, down_P, seen_object.ravel()])


def track_root(root: Array, seen: Array | None, turning: float, hold_s: float, dt_s: float) -> Array:
    """The root one measurement later: moved on with its velocity, turned by the gyro, corrected by what is `seen`.

    Args:
        root: (8,) x, y, z [m], sine and cosine of the heading, velocity [m/s].
        seen: (4,) x, y, z [m], heading [rad]; None between refreshes.
        turning: rate of the heading [rad/s]. hold_s: time between refreshes [s]. dt_s: time that passed [s].
    """
    velocity = root[_VELOCITY]
    place, yaw = root[_PLACE] + dt_s * velocity, float(np.arctan2(root[3], root[4])) + dt_s * turning
    if seen is not None:
        off, yaw_off = seen[:3] - place, float(seen[3]) - yaw
        place, velocity = place + TRACK_PLACE * off, velocity + TRACK_VELOCITY / hold_s * off
        yaw += TRACK_HEADING * float(np.arctan2(np.sin(yaw_off), np.cos(yaw_off)))
    return np.concatenate([place, [np.sin(yaw), np.cos(yaw)], velocity])


def root_at(seen: Array) -> Array:
    """The root (8,), see `track_root`, at rest where it is seen (4,)."""
    return np.concatenate([seen[:3], np.sin(seen[3:]), np.cos(seen[3:]), np.zeros(3)])


def heading(root: Array) -> Array:
    """Heading (1,) of a root (8,) [rad]."""
    return np.arctan2(root[3:4], root[4:5])


def track_gravity(down_P: Array, gravity_P: Array, w_WP_P: Array, gain: float, dt_s: float) -> Array:
    """The direction of gravity (3,) one measurement later: turned by the gyro, corrected by what is measured.

    Args:
        down_P: (3,) the last one. gravity_P: (3,) measured. w_WP_P: (3,) gyro [rad/s].
        gain: weight of what is measured; 1 forgets all else. dt_s: time that passed [s].
    """
    down_P = blend(down_P + dt_s * np.cross(down_P, w_WP_P), gravity_P, gain)
    return down_P / np.linalg.norm(down_P)


def blend(old: Array, new: Array, gain: float) -> Array:
    """From the old towards the new by a share of their difference: a low-pass filter."""
    return old + gain * (new - old)


def right_angled(x: Array, y: Array) -> Array:
    """Rotation (3, 3) whose first axis is along x (3,), its second towards y (3,)."""
    x = x / np.linalg.norm(x)
    z = np.cross(x, y)
    z = z / np.linalg.norm(z)
    return np.column_stack([x, np.cross(z, x), z])


def attitude(yaw: float, down_P: Array) -> Array:
    """R_WP (3, 3) from the heading [rad] and the direction of gravity in P, a unit vector."""
    along, across, up = -down_P
    level = np.hypot(across, up)
    R_YP = np.array(
        [
            [level, -along * across / level, -along * up / level],
            [0.0, up / level, -across / level],
            [along, across, up],
        ]
    )
    return rotation_z(yaw) @ R_YP
