"""Loss terms of PPO, each for one agent."""

from __future__ import annotations

import torch
from torch import Tensor


def clipped_surrogate(ratio: Tensor, advantage: Tensor, clip: float) -> Tensor:
    """−J^PPO: minus the mean of min(r A, clip(r) A) (Schulman et al. 2017), (B,), (B,) -> ()."""
    return -torch.minimum(ratio * advantage, ratio.clamp(1.0 - clip, 1.0 + clip) * advantage).mean()


def clipped_value(value: Tensor, old: Tensor, returns: Tensor, clip: float) -> Tensor:
    """Value loss that ignores improvements beyond the clip, (B,) -> ()."""
    near = old + (value - old).clamp(-clip, clip)
    return torch.maximum((value - returns).square(), (near - returns).square()).mean()
