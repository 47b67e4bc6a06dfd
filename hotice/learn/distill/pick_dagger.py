"""From plans to a policy: DAgger whose teacher is a book of picks, played back with the true state in sight.

At first the teacher drives, because an untrained student falls before it has seen anything; then more and more robots
are the student's. Where one of them is about to fall, the teacher takes over (SafeDAgger, Zhang and Cho 2017). Whoever
drives, the teacher says of every state what it would have done.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

import torch
from torch import Tensor

from hotice.files import read_bytes
from hotice.learn.distill.dagger import Dagger, DistillRunner
from hotice.learn.distill.labels import Labels, ReplayBuffer
from hotice.learn.distill.pick_config import PickDistillConfig
from hotice.learn.train.pickup import pickup_env
from hotice.learn.train.runner import Runner
from hotice.model.picks.book import MAX_BYTES
from hotice.sim.observations import mirror_action
from hotice.sim.pickup.env import PickUpEnv


@dataclass(frozen=True, kw_only=True)
class BookTeacher:
    """std (1, 20): standard deviation that the student is pulled to. sources: SHA-256 by file."""

    std: Tensor
    sources: dict[str, str]


class PickDistillRunner(DistillRunner):
    """Trains a student of a book of picks."""

    config: PickDistillConfig  # type: ignore[assignment]
    env: PickUpEnv  # type: ignore[assignment]

    def __init__(self, config: PickDistillConfig, env: PickUpEnv | None = None) -> None:
        super().__init__(config, env or pickup_env(config, config.picks))  # type: ignore[arg-type]

    def _spread(self) -> None:
        self.env.spread()

    def _make_learner(self, generator: torch.Generator) -> Dagger:
        cfg, env = self.config, self.env
        assert cfg.picks is not None
        digest = hashlib.sha256(read_bytes(cfg.picks, MAX_BYTES)).hexdigest()
        std = torch.tensor([[cfg.init_std[0]] * 12 + [cfg.init_std[1]] * 8], device=env.device)
        steps, n, size = cfg.ppo.steps, env.num_envs, env.policy_table.size
        self.sensed = torch.zeros(steps, n, size, device=env.device)
        self.wanted = torch.zeros(steps, n, 20, device=env.device)
        labels = ReplayBuffer(cfg.aggregate, steps * n, size, env.device)
        teacher = BookTeacher(std=std, sources={str(cfg.picks): digest})
        mirror = env.policy_table.mirror
        return Dagger(self.net, cfg, mirror, mirror_action, generator, teacher, labels)  # type: ignore[arg-type]

    def collect(self) -> None:
        """Fills the rollout; labels were asked for on the way."""
        Runner.collect(self)
        none = torch.zeros(self.wanted[..., 0].numel(), dtype=torch.int64, device=self.env.device)
        self.algo.labels.add(Labels(obs=self.sensed.flatten(0, 1), mean=self.wanted.flatten(0, 1), teacher=none))

    def _act(self, t: int) -> Tensor:
        env, s = self.env, self.env.snapshot()
        self.sensed[t] = self.obs
        self.wanted[t] = env.label(s)
        action = Runner._act(self, t)
        mine = round(self.config.share(self.update) * env.num_envs)
        taught = (env.everyone >= mine) | (s.offset.norm(dim=1) > self.config.rescue_m)
        return torch.where(taught[:, None], self.wanted[t], action)
