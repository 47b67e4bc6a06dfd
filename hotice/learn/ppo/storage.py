"""Rollout memory: T steps of N environments."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import torch
from torch import Tensor

from hotice.model import g1


@dataclass
class Batch:
    """A minibatch, leading axis B; A agents."""

    obs: Tensor
    critic_obs: Tensor
    action: Tensor
    mean: Tensor
    log_prob: Tensor  # (B, A)
    value: Tensor  # (B, A)
    advantage: Tensor  # (B, A)
    returns: Tensor  # (B, A)


class Rollout:
    """Fixed tensors (T, N, ...), filled step by step. Observations are stored normalised, as the policy saw them."""

    def __init__(self, steps: int, num_envs: int, obs: int, critic_obs: int, agents: int, device: torch.device) -> None:
        def zeros(*shape: int, dtype=torch.float32) -> Tensor:
            return torch.zeros(steps, num_envs, *shape, device=device, dtype=dtype)

        self.obs, self.critic_obs = zeros(obs), zeros(critic_obs)
        self.action, self.mean = zeros(g1.ACTIONS), zeros(g1.ACTIONS)
        self.log_prob, self.value = zeros(agents), zeros(agents)
        self.reward, self.final_value = zeros(agents), zeros(agents)
        self.terminated, self.truncated = zeros(dtype=torch.bool), zeros(dtype=torch.bool)
        self.advantage, self.returns = zeros(agents), zeros(agents)

    def minibatches(self, count: int, generator: torch.Generator) -> Iterator[Batch]:
        """Shuffled minibatches; advantages are normalised per agent over the whole rollout beforehand."""
        flat = {name: getattr(self, name).flatten(0, 1) for name in Batch.__dataclass_fields__}
        total = len(flat["obs"])
        order = torch.randperm(total, generator=generator, device=generator.device)
        for ids in order.split(total // count):
            yield Batch(**{name: value.index_select(0, ids) for name, value in flat.items()})
