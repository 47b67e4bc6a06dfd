"""Specialist to generalist: DAgger (Ross et al. 2011; paper, IV-C).

The student acts on what a robot can sense, in the perturbed task; the teacher of the scene says what it would have
done, seeing the true state. The student minimises the divergence of its Gaussian from the teacher's, summed over both
agents:

    J = Σ_agents KL(π_student ‖ π_teacher) + value loss

In this direction the error of the mean is weighed by the teacher's precision, which is constant, and the student's
spread is pulled to the teacher's (CAT takes the same). The other direction would weigh by the student's own spread,
which grows where teachers disagree about what looks alike under noise: more exploration than any teacher had, where it
can afford it least.

Critics learn on the way, from the student's own returns: their targets are right for the policy and the noise that PPO
goes on with, which the teachers' values (of a better policy in an exact world) are not.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from hotice.errors import CheckpointError
from hotice.learn.checkpoints.checkpoint import read_meta
from hotice.learn.checkpoints.lineage import line_of
from hotice.learn.checkpoints.trained_on import TrainedOn
from hotice.learn.distill.config import DistillConfig
from hotice.learn.distill.labels import Labels, ReplayBuffer
from hotice.learn.distill.teachers import Teachers
from hotice.learn.ppo.learner import Learner, Mirror
from hotice.learn.ppo.losses import clipped_value
from hotice.learn.ppo.networks import ActorCritic, kl_divergence
from hotice.learn.ppo.storage import Batch, Rollout
from hotice.learn.train.config import config_to_dict
from hotice.learn.train.runner import Runner
from hotice.sim.observations import mirror_action


class Dagger(Learner):
    """Pulls the actors to their teachers and the critics to the returns."""

    kind = "dagger"

    def __init__(
        self,
        net: ActorCritic,
        config: DistillConfig,
        mirror_obs: Mirror,
        mirror_action: Mirror,
        generator: torch.Generator,
        teachers: Teachers,
        labels: ReplayBuffer,
    ) -> None:
        super().__init__(net, config.ppo, mirror_obs, mirror_action, generator)
        self.exploration, self.teachers, self.labels = config.exploration, teachers, labels

    def sample(self, obs: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        action, mean, log_prob = super().sample(obs)
        return mean + self.exploration * (action - mean), mean, log_prob

    def update(self, rollout: Rollout) -> dict[str, float]:
        cfg = self.config
        rollout.returns = rollout.advantage + rollout.value
        return self._summary(
            self._minibatch(batch, labels)
            for _ in range(cfg.epochs)
            for batch, labels in zip(
                rollout.minibatches(cfg.minibatches, self.generator),
                self.labels.minibatches(cfg.minibatches, self.generator),
                strict=True,
            )
        )

    def _minibatch(self, batch: Batch, labels: Labels) -> dict[str, float]:
        """A step of the actors towards the labels and of the critics towards the newest returns."""
        cfg, net = self.config, self.net
        obs = net.obs_norm(labels.obs)
        mean, std, teacher_std = net.mean(obs), net.std(), self.teachers.std[labels.teacher]
        value = net.values(batch.critic_obs)
        log: dict[str, float] = {}
        loss = torch.zeros((), device=mean.device)
        for i, agent in enumerate(net.agents):
            part = agent.actions
            kl = kl_divergence(mean[:, part], std[part], labels.mean[:, part], teacher_std[:, part]).mean()
            value_loss = clipped_value(value[:, i], batch.value[:, i], batch.returns[:, i], cfg.value_clip)
            loss = loss + kl + cfg.value_weight * value_loss
            error = (mean[:, part] - labels.mean[:, part]).square().mean().sqrt()
            log |= {
                f"kl/{agent.name}": float(kl.detach()),
                f"action_error/{agent.name}": float(error.detach()),
                f"value/{agent.name}": float(value_loss.detach()),
            }
        if cfg.mirror_weight > 0:
            mirror = self._mirror_loss(obs, mean)
            loss = loss + cfg.mirror_weight * mirror
            log["mirror"] = float(mirror.detach())
        self._minimise(loss)
        return log

    def own_state(self) -> dict[str, Tensor]:
        return super().own_state() | self.labels.state()

    def meta(self) -> dict[str, Any]:
        return super().meta() | {"teachers": self.teachers.sources}

    def load_state(self, tensors: dict[str, Tensor], meta: dict[str, Any]) -> None:
        if sorted(meta["teachers"].values()) != sorted(self.teachers.sources.values()):
            raise CheckpointError(
                f"the teachers are not those that the student began with ({', '.join(meta['teachers'])}): "
                "give these checkpoints again, or another folder as out"
            )
        super().load_state(tensors, meta)

    def load_own_state(self, tensors: dict[str, Tensor]) -> None:
        super().load_own_state(tensors)
        self.labels.load_state(tensors)


class DistillRunner(Runner):
    """Trains a student; the loop, checkpoints and signals are those of `Runner`."""

    config: DistillConfig
    algo: Dagger

    def _make_learner(self, generator: torch.Generator) -> Dagger:
        cfg, env = self.config, self.env
        teachers = Teachers.load(cfg.teachers, cfg.generalist, env, config_to_dict(cfg.task), cfg.preset)
        for folder in teachers.sources:
            meta = read_meta(Path(folder))
            self.ancestors |= line_of(meta)
            self.trained_on = TrainedOn.of_meta(meta, folder) | self.trained_on
        steps, n, size = cfg.ppo.steps, env.num_envs, env.policy_table.size
        self.sensed = torch.zeros(steps, n, size, device=env.device)
        self.truth = torch.zeros_like(self.sensed)
        self.scene = torch.zeros(steps, n, dtype=torch.int64, device=env.device)
        labels = ReplayBuffer(cfg.aggregate, steps * n, size, env.device)
        return Dagger(self.net, cfg, env.policy_table.mirror, mirror_action, generator, teachers, labels)

    def collect(self) -> None:
        """Fills the rollout, then asks the teachers about all of it."""
        super().collect()
        mean, teacher = self.algo.teachers.label(self.truth.flatten(0, 1), self.scene.flatten())
        self.algo.labels.add(Labels(obs=self.sensed.flatten(0, 1), mean=mean, teacher=teacher))

    def _act(self, t: int) -> Tensor:
        self.sensed[t], self.scene[t] = self.obs, self.env.memory.scene
        # critics read the actors' rows of the true state first
        self.truth[t] = self.critic_obs[:, : self.sensed.shape[2]]
        return super()._act(t)
