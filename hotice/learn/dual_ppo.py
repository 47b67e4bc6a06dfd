"""Dual-agent PPO: own advantage an agent, one summed objective J = J_low + J_up (paper, IV-B).

A single agent is the same algorithm with a list of one.
"""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor

from hotice.errors import InvalidConfig
from hotice.learn.config import PpoConfig
from hotice.learn.losses import clipped_surrogate, clipped_value
from hotice.learn.networks import ActorCritic, kl_divergence, log_prob
from hotice.learn.storage import Batch, Rollout

Mirror = Callable[[Tensor], Tensor]


class DualPpo:
    """Optimises the agents of an `ActorCritic`; each agent has its own learning rate, led by its own KL divergence."""

    def __init__(
        self, net: ActorCritic, config: PpoConfig, mirror_obs: Mirror, mirror_action: Mirror, generator: torch.Generator
    ) -> None:
        self.net, self.config, self.generator = net, config, generator
        self.mirror_obs, self.mirror_action = mirror_obs, mirror_action
        groups = [{"params": list(net.nets[a.name].parameters()), "lr": config.learning_rate} for a in net.agents]
        self.optimizer = torch.optim.Adam(groups, eps=1e-5, fused=True)
        self.skipped = 0

    def sample(self, obs: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Action (N, 20), its mean, and log-probabilities (N, A), from normalised observations."""
        mean, std = self.net.mean(obs), self.net.std()
        noise = torch.randn(mean.shape, generator=self.generator, device=mean.device)
        action = mean + std * noise
        return action, mean, self._log_probs(action, mean, std)

    def _log_probs(self, action: Tensor, mean: Tensor, std: Tensor) -> Tensor:
        parts = [log_prob(action[:, a.actions], mean[:, a.actions], std[a.actions]) for a in self.net.agents]
        return torch.stack(parts, dim=-1)

    def update(self, rollout: Rollout) -> dict[str, float]:
        """Several passes over a rollout; returns means of what happened."""
        cfg, net = self.config, self.net
        rollout.returns = rollout.advantage + rollout.value
        flat = rollout.advantage.flatten(0, 1)
        rollout.advantage = (rollout.advantage - flat.mean(0)) / (flat.std(0) + 1e-8)
        std_old = net.std().detach().clone()
        log: dict[str, list[float]] = {}
        for _ in range(cfg.epochs):
            for batch in rollout.minibatches(cfg.minibatches, self.generator):
                for key, value in self._minibatch(batch, std_old).items():
                    log.setdefault(key, []).append(value)
        result = {key: sum(values) / len(values) for key, values in log.items()}
        for agent, group in zip(net.agents, self.optimizer.param_groups, strict=True):
            result[f"learning_rate/{agent.name}"] = group["lr"]
            result[f"std/{agent.name}"] = float(net.std()[agent.actions].detach().mean())
        result["skipped_minibatches"] = float(self.skipped)
        return result

    def _minibatch(self, batch: Batch, std_old: Tensor) -> dict[str, float]:
        cfg, net = self.config, self.net
        mean, std = net.mean(batch.obs), net.std()
        value = net.values(batch.critic_obs)
        ratio = (self._log_probs(batch.action, mean, std) - batch.log_prob).exp()
        log: dict[str, float] = {}
        loss = torch.zeros((), device=mean.device)
        for i, agent in enumerate(net.agents):
            part = agent.actions
            surrogate = clipped_surrogate(ratio[:, i], batch.advantage[:, i], cfg.clip)
            value_loss = clipped_value(value[:, i], batch.value[:, i], batch.returns[:, i], cfg.value_clip)
            entropy = std[part].log().sum()
            loss = loss + surrogate + cfg.value_weight * value_loss - cfg.entropy * entropy
            with torch.no_grad():
                kl = float(kl_divergence(batch.mean[:, part], std_old[part], mean[:, part], std[part]).mean())
            self._adapt(i, kl)
            log |= {
                f"surrogate/{agent.name}": float(surrogate.detach()),
                f"value/{agent.name}": float(value_loss.detach()),
                f"kl/{agent.name}": kl,
            }
        if cfg.mirror_weight > 0:
            with torch.no_grad():
                target = self.mirror_action(mean)
            mirror = (net.mean(self.mirror_obs(batch.obs)) - target).square().mean()
            loss = loss + cfg.mirror_weight * mirror
            log["mirror"] = float(mirror.detach())
        self.optimizer.zero_grad(set_to_none=True)
        loss.backward()
        self._descend()
        return log

    def _descend(self) -> None:
        """One step, unless a gradient is not finite: then the minibatch is left out and counted."""
        norms = []
        for group in self.optimizer.param_groups:
            norms.append(torch.nn.utils.clip_grad_norm_(group["params"], self.config.max_grad_norm))
        if not all(bool(torch.isfinite(n)) for n in norms):
            self.skipped += 1
            if self.skipped > 100:
                raise InvalidConfig(
                    "more than 100 minibatches had gradients that are not finite: lower the learning rate"
                )
            return
        self.optimizer.step()
        with torch.no_grad():
            for agent in self.net.agents:
                self.net.nets[agent.name].log_std.clamp_(min=torch.log(torch.tensor(self.config.min_std)).item())  # type: ignore[union-attr,operator]

    def _adapt(self, index: int, kl: float) -> None:
        """Learning rate up when the policy moved too little, down when too much (Schulman et al. 2017)."""
        group, cfg = self.optimizer.param_groups[index], self.config
        if kl > 2.0 * cfg.target_kl:
            group["lr"] = max(1e-5, group["lr"] / 1.5)
        elif 0.0 < kl < 0.5 * cfg.target_kl:
            group["lr"] = min(cfg.max_learning_rate, group["lr"] * 1.5)
