"""The training loop: act, step, store, estimate, update, save."""

from __future__ import annotations

import contextlib
import time

import torch
from torch import Tensor

from hotice.errors import InvalidConfig, OutputError
from hotice.learn import distributed
from hotice.learn.checkpoints.checkpoint import list_checkpoints, read_meta, resolve, updates_of
from hotice.learn.checkpoints.health import check_network, check_physics
from hotice.learn.ppo.gae import gae
from hotice.learn.train.config import TrainConfig, write_config
from hotice.learn.train.progress import Progress
from hotice.learn.train.resume import begin_from, load_run, save_run
from hotice.learn.train.run import Run
from hotice.learn.train.signals import stop_on_signals
from hotice.learn.train.statistics import by_family
from hotice.learn.train.trials import Trials
from hotice.learn.train.wandb_sync import check_wandb
from hotice.learn.train.ways_picture import ways_figure
from hotice.owner import sole_owner
from hotice.sim.batch_env import Step
from hotice.sim.env import TransportEnv


def check_start(config: TrainConfig) -> bool:
    """Whether a run goes on from a checkpoint of its own; what it begins from is read before anything is built.

    Raises `MissingExtra`, `InvalidConfig` or `CheckpointError` for what is not there.
    """
    check_wandb(config)
    goes_on = config.resume and bool(list_checkpoints(config.out))
    if config.NEEDS_INIT and config.init is None and not goes_on:
        raise InvalidConfig("no init: the checkpoint or run of a student is needed")
    for path in config.begins_from():
        if not (goes_on and path == config.init):
            read_meta(resolve(path))
    return goes_on


def check_run_folder(config: TrainConfig, update: int) -> None:
    """Raises `OutputError` where the folder holds another run, or a later state of this one than after `update`."""
    out, there = config.out, list_checkpoints(config.out)
    if not there:
        return
    if not (config.resume or update):
        raise OutputError(
            f"{out}: holds {there[-1].name} of an earlier run: give --resume to go on with it, or another "
            "folder as --out"
        )
    if config.resume and updates_of(there[-1]) > update:
        raise OutputError(
            f"{out}: {there[-1].name} was written there after this run began: run the same command again to go "
            "on with it"
        )


class Runner(Run):
    """Runner of one training; checkpoints hold all that later updates depend on, so resuming is exact to the bit."""

    def __init__(self, config: TrainConfig, env: TransportEnv | None = None) -> None:
        if config.split.several:
            raise InvalidConfig(
                f"branches is {config.split.branches}: a Runner is one process, branches are run by "
                "hotice.learn.branches.run.BranchedRun"
            )
        goes_on = check_start(config)
        super().__init__(config, env)
        self._saved_at = time.monotonic()
        self._trials: Trials | None = None
        self._tried = -1
        if goes_on:
            load_run(self, config.out)
        elif config.init is not None:
            begin_from(self, config.init)

    def train(self) -> bool:
        """Runs until the limit of updates or minutes; saves at the end, also when interrupted: then False.

        Raises `OutputError` where the folder holds another run, whose checkpoints would outlive the new ones, or is
        another process's.
        """
        check_run_folder(self.config, self.update)
        with sole_owner(self.config.out) if distributed.rank() == 0 else contextlib.nullcontext():
            check_run_folder(self.config, self.update)
            return self._train()

    def _train(self) -> bool:
        cfg = self.config
        begin, minutes_before = time.monotonic(), self.minutes
        leads = distributed.rank() == 0
        if leads:
            write_config(cfg)
        shown = Progress(cfg, self.update, self.steps) if leads else contextlib.nullcontext()
        late = stopped = False
        skipped = self.algo.skipped
        with shown as progress, stop_on_signals() as signalled:
            if progress and self.notice:
                progress.note(self.notice)
            while self.update < cfg.updates and not (late or stopped):
                log = self.learn_once()
                self.minutes = minutes_before + (time.monotonic() - begin) / 60.0
                late = cfg.max_minutes > 0 and self.minutes - minutes_before >= cfg.max_minutes
                stopped, late, due = distributed.any_rank(signalled.is_set(), late, self.due())
                if progress:
                    progress.report(self.update, self.steps, self.minutes, log)
                    if self.algo.skipped > skipped:
                        progress.note(f"update {self.update}: left out minibatches whose gradients were not finite")
                skipped = self.algo.skipped
                if due and not (late or stopped):
                    self.save()
                    self._try(progress)
            if progress and stopped:
                progress.note("asked to stop: saving")
            self.save()
            if not stopped:
                self._try(progress)
        return not stopped

    def _try(self, progress: Progress | None) -> None:
        """Walks the trials that were asked for with the averaged policy, and tells how they went."""
        if progress is None or not self.config.trials or self._tried == self.update:
            return
        self._tried = self.update
        if self._trials is None:
            self._trials = Trials(self.env, self.config)
        results = self._trials.run(self.net, self.average)
        progress.trials(self.steps, results, ways_figure(results, self.env.bank))

    def learn_once(self) -> dict[str, float]:
        """One rollout and one update; returns what is logged of them."""
        begin, unstable = time.monotonic(), self.env.unstable
        self.collect()
        check_physics(self.env.unstable - unstable, self.env.num_envs, self.update + 1, self.config.out)
        middle = time.monotonic()
        log = self._learn() | self._choose_next()
        end = time.monotonic()
        steps = distributed.size() * self.env.num_envs * self.config.ppo.steps
        self.steps += steps
        return log | {
            "seconds/collect": middle - begin,
            "seconds/learn": end - middle,
            "steps_per_s": steps / (end - begin),
            "reward": float(self.rollout.reward.mean()),
            **{f"term/{name}": value for name, value in self.terms.items()},
            "unstable": float(self.env.unstable),
        }

    @torch.no_grad()
    def collect(self) -> None:
        """Fills the rollout and estimates advantages."""
        terms = torch.zeros(len(self.env.rewards.names), device=self.env.device)
        for t in range(self.config.ppo.steps):
            actions = self._act(t)
            step = self.env.step(actions)
            self._process(t, step)
            terms += step.terms.mean(dim=0)
        self.terms = dict(zip(self.env.rewards.names, (terms / self.config.ppo.steps).tolist(), strict=True))
        self._estimate()

    def _act(self, t: int) -> Tensor:
        """Writes what the agents saw and did into row t of the rollout; returns the actions (N, 20)."""
        net, r = self.net, self.rollout
        r.obs[t], r.critic_obs[t] = net.obs_norm(self.obs), net.critic_norm(self.critic_obs)
        r.value[t] = net.values(r.critic_obs[t])
        r.action[t], r.mean[t], r.log_prob[t] = self.algo.sample(r.obs[t])
        return r.action[t]

    def _process(self, t: int, step: Step) -> None:
        """Writes what came of it into row t; where an episode was cut off, also the value of where it ended."""
        net, r = self.net, self.rollout
        r.reward[t], r.terminated[t], r.truncated[t] = step.reward, step.terminated, step.truncated
        if step.truncated.any():
            ids = torch.nonzero(step.truncated).squeeze(1)
            r.final_value[t, ids] = net.values(net.critic_norm(step.final_critic[ids]))
        self.obs, self.critic_obs = step.policy, step.critic
        self.stats.add(step)

    def _estimate(self) -> None:
        """Advantages of the rollout."""
        net, r, ppo = self.net, self.rollout, self.config.ppo
        last = net.values(net.critic_norm(self.critic_obs))
        r.advantage = gae(r.reward, r.value, last, r.final_value, r.terminated, r.truncated, ppo.gamma, ppo.lam)

    def _learn(self) -> dict[str, float]:
        """An update of networks, normalisers and average from the rollout. Raises `DivergedError`."""
        self.algo.train_actors(self.update >= self.config.critic_updates)
        log = self.algo.update(self.rollout)
        self._observe_statistics()
        self.average.update(self.net)
        self.update += 1
        check_network(self.net, self.update, self.config.out)
        return log

    def _choose_next(self) -> dict[str, float]:
        """Takes in the episodes that ended: they decide which scenes, goals and objects come next."""
        distributed.add_up(self.stats.counters)
        log, ended, successes = self.stats.pop()
        if self.config.curriculum:
            self.curriculum.update(ended, successes)
            self.env.starter.scene_weight.copy_(self.curriculum.weights())
            log["curriculum/solved"] = float((self.curriculum.rate > 0.8).float().mean())
        self.stages.update(float(ended.sum()), float(successes.sum()))
        return log | by_family(self.env.bank.names, ended, successes) | self.stages.log()

    def _observe_statistics(self) -> None:
        """Updates the normalisers, once an update, with the newest observations and their mirror images."""
        env = self.env
        obs, critic_obs = distributed.concatenate(self.obs), distributed.concatenate(self.critic_obs)
        self.net.obs_norm.update(torch.cat([obs, env.policy_table.mirror(obs)]))
        self.net.critic_norm.update(torch.cat([critic_obs, env.critic_table.mirror(critic_obs)]))

    def save(self) -> None:
        """Writes a checkpoint. Raises `OutputError`."""
        self._saved_at = time.monotonic()
        save_run(self)

    def due(self) -> bool:
        """Whether a checkpoint is to be written by now, by time or number of updates."""
        every = self.config.checkpoint_updates
        late = time.monotonic() - self._saved_at > 60.0 * self.config.checkpoint_minutes
        return late or bool(every and self.update % every == 0)
