"""Teacher labels of the states of the last rollouts."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import torch
from torch import Tensor

from hotice.errors import CheckpointError


@dataclass(frozen=True, kw_only=True)
class Labels:
    """B states with their teacher's action: raw student observation (B, O), mean (B, 20), teacher (B,)."""

    obs: Tensor
    mean: Tensor
    teacher: Tensor


class ReplayBuffer:
    """Ring of the labels of the last `keep` rollouts of B states each. With `keep` = 1 learning is on-policy."""

    def __init__(self, keep: int, size: int, obs: int, device: torch.device) -> None:
        self.obs = torch.zeros(keep, size, obs, device=device)
        self.mean = torch.zeros(keep, size, 20, device=device)
        self.teacher = torch.zeros(keep, size, dtype=torch.int64, device=device)
        self.added = 0

    def add(self, labels: Labels) -> None:
        """Takes in a rollout; the oldest makes room."""
        row = self.added % len(self.obs)
        self.obs[row], self.mean[row], self.teacher[row] = labels.obs, labels.mean, labels.teacher
        self.added += 1

    def minibatches(self, count: int, generator: torch.Generator) -> Iterator[Labels]:
        """As many minibatches as a rollout has, without repetition, drawn from all rollouts that are kept."""
        filled, size = min(self.added, len(self.obs)), self.obs.shape[1]
        obs, mean, teacher = (t[:filled].flatten(0, 1) for t in (self.obs, self.mean, self.teacher))
        order = torch.randperm(filled * size, generator=generator, device=generator.device)[:size]
        for ids in order.split(size // count):
            yield Labels(obs=obs[ids], mean=mean[ids], teacher=teacher[ids])

    def state(self) -> dict[str, Tensor]:
        """Tensors that later updates depend on: none when each rollout replaces the last."""
        if len(self.obs) == 1:
            return {}
        return {
            "replay.obs": self.obs,
            "replay.mean": self.mean,
            "replay.teacher": self.teacher,
            "replay.added": torch.tensor(self.added),
        }

    def load_state(self, tensors: dict[str, Tensor]) -> None:
        """Restores `state` of an equal buffer. Raises `CheckpointError` for one of another size."""
        if len(self.obs) > 1:
            if "replay.obs" not in tensors or tensors["replay.obs"].shape != self.obs.shape:
                raise CheckpointError(
                    "rollouts that were kept differ in number or size: resume with the same aggregate, steps and "
                    "num_envs"
                )
            for name in ("obs", "mean", "teacher"):
                getattr(self, name).copy_(tensors[f"replay.{name}"])
            self.added = int(tensors["replay.added"])
