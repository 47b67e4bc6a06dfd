"""A leg in the sagittal plane: how far a lifted foot has to point down so that its ankle can follow."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hotice.control.walk.ground import SOLE_FRONT_M

Array = NDArray[np.float64]
HIP_ASIDE_M, HIP_BELOW_M = 0.117, 0.133
"""The hip's pitch axis from the pelvis."""
THIGH_M, SHANK_M, ANKLE_HEIGHT_M = 0.307, 0.300, 0.018
"""Lengths of the leg, and the ankle's pitch axis over the origin of the foot."""
ANKLE_BEND_RAD = 0.78
"""Largest upward bend of a lifted foot [rad]; the joint ends at 0.873."""
MOST_DOWN_RAD = 0.8


def toe_down(p_WP: Array, R_WP: Array, side: float, pose: Array) -> tuple[float, float]:
    """Pitch of a swing foot [rad], and how much higher it has to be for its toe [m].

    A foot that is lifted far behind the hip would bend its ankle beyond its range if it stayed level.

    Args:
        p_WP: (3,) pelvis [m], R_WP its orientation. side: +1 left, -1 right. pose: (4,) x, y, z [m], yaw [rad] of a
            level foot.
    """
    hip = p_WP + R_WP @ np.array([0.0, side * HIP_ASIDE_M, -HIP_BELOW_M])
    ahead = np.cos(pose[3]) * (pose[0] - hip[0]) + np.sin(pose[3]) * (pose[1] - hip[1])
    pitch = lift = 0.0
    for _ in range(3):  # lifting bends the knee further
        below = hip[2] - (pose[2] + lift + ANKLE_HEIGHT_M)
        length = min(float(np.hypot(ahead, below)), THIGH_M + SHANK_M - 1e-3)
        bend = np.arccos(np.clip((length**2 + SHANK_M**2 - THIGH_M**2) / (2 * length * SHANK_M), -1.0, 1.0))
        shank = bend - np.arctan2(ahead, below)  # forward lean of the shank
        pitch = float(np.clip(shank - ANKLE_BEND_RAD, 0.0, MOST_DOWN_RAD))
        lift = SOLE_FRONT_M * float(np.sin(pitch))
    return pitch, lift
