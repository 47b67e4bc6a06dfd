"""The navigation command c: what the guidance field asks of locomotion. NumPy or torch, one robot or a batch.

The paper aggregates c from the Standard Guidance Field at head, pelvis and feet and leaves open how. Here: the mean of
the four vectors, each shortened to at most eta (a foot brushing an obstacle must not drown the others), its horizontal
part rescaled to the walking speed, which falls with the distance so that the root comes to rest on the goal. The
vertical part stays the mean's, whatever the walking speed, and fades with it near the goal.
"""

from __future__ import annotations

from typing import Any

from hotice.arrays import clip, length, namespace

NEAR_M = 0.4
"""Closer to the goal than this, the command turns straight to it."""


def navigation_command(
    force_W: Any, offset_W: Any, attraction: float, speed_m_s: float, stop_gain_hz: float
) -> tuple[Any, Any]:
    """Command c_W (..., 3) [m/s] with |c_xy| = speed, and speed (...) [m/s]; of the kind of the arrays given.

    Args:
        force_W: (..., 4, 3) Standard Guidance Field at head, pelvis and feet [m/s].
        offset_W: (..., 2) horizontal vector from root to goal [m].
        attraction: eta of that field, to which longer vectors are cut [m/s].
        speed_m_s: walking speed far from the goal. stop_gain_hz: speed per distance near it.
    """
    c_W = (force_W * (attraction / clip(length(force_W), attraction))[..., None]).sum(-2) / force_W.shape[-2]
    distance = length(offset_W)
    speed = clip(stop_gain_hz * distance, None, speed_m_s)
    # close by, straight at the goal: feet and head disagree
    near = clip(1.0 - distance / NEAR_M, 0.0)
    along_W = c_W[..., :2]
    along_W = along_W / clip(length(along_W), 1e-6)[..., None]
    straight_W = offset_W / clip(distance, 1e-6)[..., None]
    blend_W = (1.0 - near)[..., None] * along_W + near[..., None] * straight_W
    horizontal = blend_W / clip(length(blend_W), 1e-12)[..., None] * speed[..., None]
    vertical = c_W[..., 2:] * (speed / speed_m_s)[..., None]
    return namespace(c_W).concat([horizontal, vertical], -1), speed


def heading_error(c_W: Any, speed: Any, yaw: Any, speed_m_s: float) -> Any:
    """Angle from heading to command, (...) [rad], fading out as the speed does (no turning at the goal).

    Args:
        c_W: (..., 3) and speed (...) as `navigation_command` gives them [m/s].
        yaw: (...) heading of the robot [rad]. speed_m_s: walking speed far from the goal.
    """
    xp = namespace(c_W)
    error = xp.atan2(c_W[..., 1], c_W[..., 0]) - yaw
    return xp.atan2(xp.sin(error), xp.cos(error)) * clip(2.0 * speed / speed_m_s - 0.5, 0.0, 1.0)
