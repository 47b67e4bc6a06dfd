"""Networks: one actor and one critic an agent, all reading the same observation (paper, IV-B)."""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch
from torch import Tensor, nn

from hotice.model import g1
from hotice.task.presets import Agent


def mlp(sizes: Sequence[int], last_gain: float) -> nn.Sequential:
    """Linear layers with ELU between, orthogonal weights, `last_gain` on the last."""
    layers: list[nn.Module] = []
    for i, (a, b) in enumerate(zip(sizes[:-1], sizes[1:], strict=True)):
        linear = nn.Linear(a, b)
        last = i == len(sizes) - 2
        nn.init.orthogonal_(linear.weight, last_gain if last else math.sqrt(2.0))
        nn.init.zeros_(linear.bias)
        layers += [linear] if last else [linear, nn.ELU()]
    return nn.Sequential(*layers)


class Normalizer(nn.Module):
    """Running mean and variance of observations; stored with the policy. Output is clipped to ± `limit`."""

    mean: Tensor
    var: Tensor
    count: Tensor

    def __init__(self, size: int, limit: float = 8.0) -> None:
        super().__init__()
        self.limit = limit
        self.register_buffer("mean", torch.zeros(size))
        self.register_buffer("var", torch.ones(size))
        self.register_buffer("count", torch.tensor(1e-4, dtype=torch.float64))

    @torch.no_grad()
    def update(self, x: Tensor) -> None:
        """Takes in a batch (N, D) (parallel variance of Chan et al.).

        Fed with observations and their mirror images, mean and variance become symmetric: normalising then commutes
        with mirroring, which the mirror loss relies on.
        """
        n = x.shape[0]
        mean, var = x.mean(dim=0), x.var(dim=0, unbiased=False)
        total = self.count + n
        delta = mean - self.mean
        share = float(n / total)
        # The means of the two parts differ: that adds to the variance of the whole.
        between = delta.square() * (float(self.count / total) * share)
        self.var.copy_(self.var * float(self.count / total) + var * share + between)
        self.mean.add_(delta * share)
        self.count.copy_(total)

    def forward(self, x: Tensor) -> Tensor:
        return ((x - self.mean) * torch.rsqrt(self.var + 1e-4)).clamp(-self.limit, self.limit)


class AgentNet(nn.Module):
    """Actor (mean and state-independent standard deviation) and privileged critic of one agent."""

    def __init__(
        self, obs: int, critic_obs: int, size: int, hidden: Sequence[int], critic_hidden: Sequence[int], std: Tensor
    ) -> None:
        super().__init__()
        # A small gain: first actions are near zero, which holds the carry state.
        self.actor = mlp([obs, *hidden, size], 0.01)
        self.critic = mlp([critic_obs, *critic_hidden, 1], 1.0)
        self.log_std = nn.Parameter(std.log())


class ActorCritic(nn.Module):
    """The agents of a preset over one observation. `act` concatenates their means: a = [a_low, a_up]."""

    def __init__(
        self,
        agents: Sequence[Agent],
        obs: int,
        critic_obs: int,
        hidden: Sequence[int],
        critic_hidden: Sequence[int],
        init_std: tuple[float, float],
    ) -> None:
        super().__init__()
        self.agents = tuple(agents)
        self.obs_norm = Normalizer(obs)
        self.critic_norm = Normalizer(critic_obs)
        std = torch.tensor([init_std[0]] * len(g1.LEG_JOINTS) + [init_std[1]] * len(g1.ARM_JOINTS))
        self.nets = nn.ModuleDict(
            {a.name: AgentNet(obs, critic_obs, a.size, hidden, critic_hidden, std[a.actions]) for a in agents}
        )

    def mean(self, obs: Tensor) -> Tensor:
        """Means of all agents from normalised observations, (N, O) -> (N, 20)."""
        return torch.cat([self.nets[a.name].actor(obs) for a in self.agents], dim=-1)  # type: ignore[union-attr]

    def std(self) -> Tensor:
        """Standard deviations, (20,)."""
        return torch.cat([self.nets[a.name].log_std for a in self.agents]).exp()  # type: ignore[union-attr,arg-type]

    def values(self, critic_obs: Tensor) -> Tensor:
        """Values of all agents from normalised privileged observations, (N, C) -> (N, A)."""
        return torch.cat([self.nets[a.name].critic(critic_obs) for a in self.agents], dim=-1)  # type: ignore[union-attr]

    def act(self, raw_obs: Tensor) -> Tensor:
        """Deterministic action of a raw observation, (N, O) -> (N, 20)."""
        return self.mean(self.obs_norm(raw_obs))

    def forward(self, raw_obs: Tensor) -> Tensor:
        return self.act(raw_obs)


def log_prob(action: Tensor, mean: Tensor, std: Tensor) -> Tensor:
    """Log density of independent Gaussians, (N, D) -> (N,)."""
    z = (action - mean) / std
    return -0.5 * z.square().sum(-1) - std.log().sum(-1) - 0.5 * action.shape[-1] * math.log(2 * math.pi)


def kl_divergence(mean_old: Tensor, std_old: Tensor, mean: Tensor, std: Tensor) -> Tensor:
    """KL(old ‖ new) of independent Gaussians, (N, D) -> (N,)."""
    ratio = std_old / std
    return (-ratio.log() + 0.5 * (ratio.square() + ((mean_old - mean) / std).square() - 1.0)).sum(-1)
