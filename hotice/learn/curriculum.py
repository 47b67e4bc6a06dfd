"""Which scenes to train on next: those that are neither solved nor hopeless."""

from __future__ import annotations

import torch
from torch import Tensor


class SceneCurriculum:
    """Draws scenes in proportion to `floor` + 4 p (1 − p), p the running rate of reaching the goal in a scene.

    p starts at a half, so that every scene is tried; goal success counts, not survival: a robot that stops before an obstacle
    has not learnt to pass it.
    """

    def __init__(self, num_scenes: int, device: torch.device, floor: float = 0.25, memory: float = 60.0) -> None:
        self.floor, self.memory = floor, memory
        self.rate = torch.full((num_scenes,), 0.5, device=device)

    def update(self, ended: Tensor, successes: Tensor) -> None:
        """Takes in episodes that ended and those of them that had reached the goal, (S,) each."""
        share = ended / (ended + self.memory)
        mean = successes / ended.clamp_min(1.0)
        self.rate += share * (mean - self.rate)

    def weights(self) -> Tensor:
        """Sampling weights, (S,)."""
        return self.floor + 4.0 * self.rate * (1.0 - self.rate)
