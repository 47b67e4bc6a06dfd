"""A training run at any moment: environment, networks, optimiser, curricula, counters."""

from __future__ import annotations

from typing import Any

import torch

from hotice.learn import distributed
from hotice.learn.checkpoints.average import AveragedPolicy
from hotice.learn.checkpoints.trained_on import GIVEN, TrainedOn
from hotice.learn.ppo.dual_ppo import DualPpo
from hotice.learn.ppo.learner import Learner
from hotice.learn.ppo.networks import ActorCritic
from hotice.learn.ppo.storage import Rollout
from hotice.learn.train.config import TrainConfig
from hotice.learn.train.curriculum import SceneCurriculum, Stages
from hotice.learn.train.statistics import EpisodeStatistics
from hotice.model.shipped import resolve_item
from hotice.sim.env import TransportEnv
from hotice.sim.observations import mirror_action
from hotice.sim.physics.threads import use_threads


class Run:
    """Everything that a later update depends on, as it is before the first one.

    ancestors: environment steps by SHA-256 of the checkpoints that weights or labels come from. trained_on: scenes.
    update, steps, minutes: counters of updates, environment steps and time. notice: what a user should know of how the
    run was resumed, or nothing. notes: what else its checkpoints say, JSON-ready.
    """

    def __init__(self, config: TrainConfig, env: TransportEnv | None = None) -> None:
        self.config = config
        self.ancestors: dict[str, int] = {}
        use_threads(config.threads)
        torch.manual_seed(config.seed)
        task = config.task.perturbed() if config.perturbed else config.task
        device = distributed.start(config.torch_device())
        seed = config.seed + distributed.SEED_STRIDE * distributed.rank()
        if env is None:
            resolved = {item: resolve_item(item) for item in dict.fromkeys(config.scenes)}
            scenes = [scene for item in config.scenes for scene in resolved[item]]
            env = TransportEnv(
                config.num_envs,
                scenes,
                preset=config.preset,
                device=device,
                physics=config.physics,
                seed=seed,
                config=task,
                threads=config.threads,
            )
        else:
            resolved = {GIVEN: env.bank.scenes}
        self.env = env
        self.trained_on = TrainedOn.of_resolved(resolved)
        self.net = ActorCritic(
            env.agents,
            env.policy_table.size,
            env.critic_table.size,
            config.hidden,
            config.critic_hidden,
            config.init_std,
        ).to(env.device)
        distributed.share(self.net)
        generator = torch.Generator(env.device).manual_seed(seed + 1)
        self.algo = self._make_learner(generator)
        self.average = AveragedPolicy(self.net, config.average)
        self.rollout = Rollout(
            config.ppo.steps, env.num_envs, env.policy_table.size, env.critic_table.size, len(env.agents), env.device
        )
        self.stats = EpisodeStatistics(env.num_envs, env.bank.num_scenes, env.device)
        self.curriculum = SceneCurriculum(env.bank.num_scenes, env.device)
        self.stages = Stages(
            env.starter, config.curriculum_distance_m, config.curriculum_objects, env.num_envs * distributed.size()
        )
        self.update = 0
        self.minutes = 0.0
        self.steps = 0
        self.notice = ""
        self.notes: dict[str, Any] = {}
        self.obs, self.critic_obs = env.reset()
        self._spread()
        self.stats.whole.copy_(env.memory.step <= 0)

    def _spread(self) -> None:
        """Lets the first episodes end at different times, so that a rollout holds all phases of an episode."""
        env = self.env
        env.memory.step.copy_(
            torch.randint(0, env.config.max_steps, (env.num_envs,), generator=env.generator, device=env.device)
        )

    def _make_learner(self, generator: torch.Generator) -> Learner:
        return DualPpo(self.net, self.config.ppo, self.env.policy_table.mirror, mirror_action, generator)
