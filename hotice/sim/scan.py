"""Points of the local obstacle scan of N environments (see `hotice.task.scan`)."""

from __future__ import annotations

import torch
from torch import Tensor

from hotice.sim.snapshot import FEET, Motion
from hotice.task import scan

_ORIGIN, _OFFSETS = torch.tensor(scan.ORIGIN), torch.tensor(scan.OFFSETS_M, dtype=torch.float32)


def scan_points(motion: Motion) -> Tensor:
    """Where N robots look, (N, 40, 3) in W [m]: ahead of feet and pelvis along the heading, at fixed heights."""
    device = motion.yaw.device
    offsets = _OFFSETS.to(device)
    origins = torch.stack([motion.p_WK[:, FEET[0], :2], motion.p_WK[:, FEET[1], :2], motion.p_WP[:, :2]], dim=1)
    ahead = torch.stack([torch.cos(motion.yaw), torch.sin(motion.yaw)], dim=1)
    across = origins[:, _ORIGIN.to(device)] + ahead[:, None] * offsets[:, :1]
    return torch.cat([across, offsets[:, 1:].expand(len(across), -1, 1)], dim=2)
