"""The navigation command c: what the guidance field asks of locomotion.

The paper aggregates c from the Standard Guidance Field at head, pelvis and feet and leaves open how. Here: the mean of
the four vectors, each shortened to at most eta (a foot brushing an obstacle must not drown the others), its horizontal
part rescaled to the walking speed, which falls with the distance so that the root comes to rest on the goal.
"""

from __future__ import annotations

import torch
from torch import Tensor

from hotice.fields.potential import FieldParams

ETA = FieldParams().attraction


def navigation_command(
    force_W: Tensor, offset_W: Tensor, speed_m_s: float, stop_gain_hz: float
) -> tuple[Tensor, Tensor]:
    """Command and speed.

    Args:
        force_W: (N, 4, 3) field at head, pelvis and feet [m/s].
        offset_W: (N, 2) horizontal vector from root to goal [m].
        speed_m_s: walking speed far from the goal. stop_gain_hz: speed per distance near it.

    Returns:
        c_W (N, 3) [m/s] with |c_xy| = speed, and speed (N,) [m/s].
    """
    size = force_W.norm(dim=-1, keepdim=True)
    c_W = (force_W * (ETA / size.clamp_min(ETA))).mean(dim=1)
    distance = offset_W.norm(dim=-1)
    speed = torch.clamp(stop_gain_hz * distance, max=speed_m_s)
    # close by, straight at the goal: feet and head disagree
    near = torch.clamp(1.0 - distance / 0.4, 0.0, 1.0)[:, None]
    straight = offset_W / distance.clamp_min(1e-6)[:, None]
    along = c_W[:, :2] / c_W[:, :2].norm(dim=-1, keepdim=True).clamp_min(1e-6)
    horizontal = torch.nn.functional.normalize((1.0 - near) * along + near * straight, dim=-1) * speed[:, None]
    vertical = c_W[:, 2:] * (speed / speed_m_s)[:, None]
    return torch.cat([horizontal, vertical], dim=-1), speed


def heading_error(c_W: Tensor, speed: Tensor, yaw: Tensor, speed_m_s: float) -> Tensor:
    """Angle from the robot's heading to the command, (N,) [rad]; fades out with the speed (no turning at the goal)."""
    error = torch.atan2(c_W[:, 1], c_W[:, 0]) - yaw
    wrapped = torch.atan2(torch.sin(error), torch.cos(error))
    return wrapped * torch.clamp(2.0 * speed / speed_m_s - 0.5, 0.0, 1.0)
