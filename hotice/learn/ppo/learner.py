"""Common part of dual PPO and distillation: networks, optimiser with one group per agent, actions, safe descent."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import Any, ClassVar

import torch
from torch import Tensor

from hotice.caches import settle_torch
from hotice.errors import DivergedError
from hotice.learn import distributed
from hotice.learn.ppo.config import PpoConfig
from hotice.learn.ppo.networks import ActorCritic, log_prob
from hotice.learn.ppo.storage import Rollout

Mirror = Callable[[Tensor], Tensor]


MIRROR_ROWS = 768
"""Rows of a large minibatch that the mirror loss looks at: all of them would cost a third of an update, yet 768 of
6,144 change the gradient of the actors by 1 %, where two minibatches differ by 130 % (measured on `carry`)."""

MANY_SKIPPED = 100
"""Minibatches in a row that may be left out because a gradient is not finite."""


class Learner:
    """Improves the agents of an `ActorCritic` from rollouts. `kind` names the objective in checkpoints."""

    kind: ClassVar[str]

    def __init__(
        self, net: ActorCritic, config: PpoConfig, mirror_obs: Mirror, mirror_action: Mirror, generator: torch.Generator
    ) -> None:
        self.net, self.config, self.generator = net, config, generator
        self.mirror_obs, self.mirror_action = mirror_obs, mirror_action
        groups = [{"params": list(net.nets[a.name].parameters()), "lr": config.learning_rate} for a in net.agents]
        settle_torch()
        self.optimizer = torch.optim.Adam(groups, eps=1e-5, fused=True)
        self.skipped = self.skipped_in_a_row = 0

    def sample(self, obs: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Action (N, 20), its mean, and log-probabilities (N, A), from normalised observations."""
        mean, std = self.net.mean(obs), self.net.std()
        noise = torch.randn(mean.shape, generator=self.generator, device=mean.device)
        action = mean + std * noise
        return action, mean, self._log_probs(action, mean, std)

    def update(self, rollout: Rollout) -> dict[str, float]:
        """Several passes over a rollout; returns means of what happened."""
        raise NotImplementedError

    def train_actors(self, wanted: bool) -> None:
        """Whether actors learn, or only critics. Gradients are absent then, not zero: Adam would rescale zeros."""
        for agent in self.net.nets.values():
            agent.actor.requires_grad_(wanted)  # type: ignore[union-attr,operator]
            agent.log_std.requires_grad_(wanted)  # type: ignore[union-attr,operator]

    # for checkpoints ------------------------------------------------------------------------------------------------

    def state(self) -> dict[str, Tensor]:
        """Tensors beside the networks that all ranks share."""
        return {
            f"optimizer.{index}.{name}": torch.as_tensor(value)
            for index, values in self.optimizer.state_dict()["state"].items()
            for name, value in values.items()
        }

    def own_state(self) -> dict[str, Tensor]:
        """Tensors that each rank has of its own."""
        return {"generator": self.generator.get_state()}

    def meta(self) -> dict[str, Any]:
        """JSON-ready values that go with `state`."""
        rates = [group["lr"] for group in self.optimizer.param_groups]
        skipped = {"skipped": self.skipped, "skipped_in_a_row": self.skipped_in_a_row}
        return {"learner": self.kind, **skipped, "learning_rates": rates}

    def load_state(self, tensors: dict[str, Tensor], meta: dict[str, Any]) -> None:
        """Restores `state` and `meta` of a run of the same kind."""
        self.load_optimizer(tensors, meta)
        self.skipped, self.skipped_in_a_row = int(meta["skipped"]), int(meta.get("skipped_in_a_row", 0))

    def load_own_state(self, tensors: dict[str, Tensor]) -> None:
        """Restores `own_state`."""
        self.generator.set_state(tensors["generator"].cpu())

    def load_optimizer(self, tensors: dict[str, Tensor], meta: dict[str, Any]) -> None:
        """Takes over moments and learning rates; the latter within this configuration's limit.

        A first learning rate other than that of the checkpoint's run is asked for: then rates begin there.
        """
        restored = self.optimizer.state_dict()
        restored["state"] = {}
        for key, value in tensors.items():
            if key.startswith("optimizer."):
                _, index, name = key.split(".", 2)
                restored["state"].setdefault(int(index), {})[name] = value
        self.optimizer.load_state_dict(restored)
        first, asked = meta["config"]["ppo"]["learning_rate"], self.config.learning_rate
        for group, rate in zip(self.optimizer.param_groups, meta["learning_rates"], strict=True):
            group["lr"] = min(rate, max(self.config.max_learning_rate, asked)) if first == asked else asked

    # for subclasses -------------------------------------------------------------------------------------------------

    def _log_probs(self, action: Tensor, mean: Tensor, std: Tensor) -> Tensor:
        parts = [log_prob(action[:, a.actions], mean[:, a.actions], std[a.actions]) for a in self.net.agents]
        return torch.stack(parts, dim=-1)

    def _mirror_loss(self, obs: Tensor, mean: Tensor) -> Tensor:
        """Mean square difference between the action in a mirrored state and the mirrored action, ().

        Estimated from `MIRROR_ROWS` evenly spaced rows or a few more.
        """
        stride = max(1, len(obs) // MIRROR_ROWS)
        # One side is held still; as every state is the mirror image of some other, both sides learn.
        obs, mean = obs[::stride], mean[::stride].detach()
        return (self.net.mean(self.mirror_obs(obs)) - self.mirror_action(mean)).square().mean()

    def _summary(self, minibatches: Iterable[dict[str, float]]) -> dict[str, float]:
        """Means over minibatches, and where learning rates and standard deviations stand."""
        log: dict[str, list[float]] = {}
        for minibatch in minibatches:
            for key, value in minibatch.items():
                log.setdefault(key, []).append(value)
        result = {key: sum(values) / len(values) for key, values in log.items()}
        for agent, group in zip(self.net.agents, self.optimizer.param_groups, strict=True):
            result[f"learning_rate/{agent.name}"] = group["lr"]
            result[f"std/{agent.name}"] = float(self.net.std()[agent.actions].detach().mean())
        result["skipped_minibatches"] = float(self.skipped)
        return result

    def _minimise(self, loss: Tensor) -> None:
        self.optimizer.zero_grad(set_to_none=True)
        loss.backward()
        self._descend()

    def _descend(self) -> None:
        """One step, unless a gradient is not finite: then the minibatch is left out and counted."""
        norms = []
        # First of all, so that all ranks clip, and leave out a minibatch, alike.
        distributed.average_gradients(self.net.parameters())
        for group in self.optimizer.param_groups:
            # By agent: a large gradient of one must not scale down the other's.
            norms.append(torch.nn.utils.clip_grad_norm_(group["params"], self.config.max_grad_norm))
        if not all(bool(torch.isfinite(n)) for n in norms):
            self.skipped += 1
            self.skipped_in_a_row += 1
            if self.skipped_in_a_row > MANY_SKIPPED:
                raise DivergedError(
                    f"{MANY_SKIPPED} minibatches in a row had gradients that are not finite: lower "
                    "--max-learning-rate and go on from the last checkpoint with --resume"
                )
            return
        self.skipped_in_a_row = 0
        self.optimizer.step()
        with torch.no_grad():
            for agent in self.net.nets.values():
                agent.log_std.clamp_(min=math.log(self.config.min_std))  # type: ignore[union-attr,operator]
