"""Dual-agent PPO: own advantage an agent, one summed objective J = J_low + J_up (paper, IV-B).

A single agent is the same algorithm with a list of one.
"""

from __future__ import annotations

import torch
from torch import Tensor

from hotice.learn import distributed
from hotice.learn.ppo.learner import Learner
from hotice.learn.ppo.losses import clipped_surrogate, clipped_value
from hotice.learn.ppo.networks import kl_divergence
from hotice.learn.ppo.storage import Batch, Rollout


class DualPpo(Learner):
    """Optimises the agents of an `ActorCritic`; each agent has its own learning rate, led by its own KL divergence."""

    kind = "ppo"

    def update(self, rollout: Rollout) -> dict[str, float]:
        cfg = self.config
        # Before advantages are normalised: critics learn returns in their own units.
        rollout.returns = rollout.advantage + rollout.value
        # Per agent, and over all ranks, so that every rank descends on the same scale.
        flat = distributed.concatenate(rollout.advantage.flatten(0, 1))
        rollout.advantage = (rollout.advantage - flat.mean(0)) / (flat.std(0) + 1e-8)
        # The spread does not depend on the state: one copy stands for the whole rollout.
        std_old = self.net.std().detach().clone()
        return self._summary(
            self._minibatch(batch, std_old)
            for _ in range(cfg.epochs)
            for batch in rollout.minibatches(cfg.minibatches, self.generator)
        )

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
            # The entropy of independent Gaussians, up to a constant.
            entropy = std[part].log().sum()
            loss = loss + surrogate + cfg.value_weight * value_loss - cfg.entropy * entropy
            with torch.no_grad():
                divergence = kl_divergence(batch.mean[:, part], std_old[part], mean[:, part], std[part]).mean()
            kl = float(distributed.mean(divergence))
            self._adapt(i, kl)
            log |= {
                f"surrogate/{agent.name}": float(surrogate.detach()),
                f"value/{agent.name}": float(value_loss.detach()),
                f"kl/{agent.name}": kl,
            }
        if cfg.mirror_weight > 0:
            mirror = self._mirror_loss(batch.obs, mean)
            loss = loss + cfg.mirror_weight * mirror
            log["mirror"] = float(mirror.detach())
        self._minimise(loss)
        return log

    def _adapt(self, index: int, kl: float) -> None:
        """Learning rate up when the policy moved too little, down when too much (Schulman et al. 2017)."""
        group, cfg = self.optimizer.param_groups[index], self.config
        if kl > 2.0 * cfg.target_kl:
            group["lr"] = max(1e-5, group["lr"] / 1.5)
        elif 0.0 < kl < 0.5 * cfg.target_kl:
            group["lr"] = min(cfg.max_learning_rate, group["lr"] * 1.5)
