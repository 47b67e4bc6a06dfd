"""The navigation command of one robot in numpy: the twin of `hotice.sim.commands`, which says how and why."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
NEAR_M = 0.4
"""Closer to the goal than this, the command turns straight to it."""


def navigation_command(
    force_W: Array, offset_W: Array, attraction: float, speed_m_s: float, stop_gain_hz: float
) -> tuple[Array, float]:
    """Command c_W (3,) and speed [m/s].

    Args:
        force_W: (4, 3) field at head, pelvis and feet [m/s].
        offset_W: (2,) horizontal vector from root to goal [m].
        attraction: eta, to which longer vectors are cut [m/s].
        speed_m_s: walking speed far from the goal. stop_gain_hz: speed per distance near it.
    """
    size = np.sqrt((force_W * force_W).sum(axis=1, keepdims=True))
    x, y, z = (force_W * (attraction / np.maximum(size, attraction))).mean(axis=0).tolist()
    dx, dy = offset_W.tolist()
    distance = math.hypot(dx, dy)
    speed = min(stop_gain_hz * distance, speed_m_s)
    near = min(max(1.0 - distance / NEAR_M, 0.0), 1.0)
    along, straight = (1.0 - near) / max(math.hypot(x, y), 1e-6), near / max(distance, 1e-6)
    hx, hy = along * x + straight * dx, along * y + straight * dy
    scale = speed / max(math.hypot(hx, hy), 1e-12)
    return np.array([hx * scale, hy * scale, z * speed / speed_m_s]), speed


def heading_error(c_W: Array, speed: float, yaw: float, speed_m_s: float) -> float:
    """Angle from heading to command [rad], fading out as the speed does (no turning at the goal)."""
    error = math.atan2(c_W[1], c_W[0]) - yaw
    wrapped = math.atan2(math.sin(error), math.cos(error))
    return wrapped * min(max(2.0 * speed / speed_m_s - 0.5, 0.0), 1.0)
