"""The training loop: act, step, store, estimate, update, save."""

from __future__ import annotations

import contextlib
import dataclasses
import json
import signal
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from types import FrameType
from typing import Any

import torch
from torch import Tensor

from hotice.errors import CheckpointError, OutputError
from hotice.failures import ran_out_of_memory
from hotice.files import make_folder, write_text
from hotice.learn import distributed
from hotice.learn.checkpoints.average import AveragedPolicy, averaged
from hotice.learn.checkpoints.checkpoint import list_checkpoints, load_checkpoint, save_checkpoint
from hotice.learn.checkpoints.health import check_network, check_physics, check_weights
from hotice.learn.checkpoints.lineage import ANCESTORS, MERGED, line_of
from hotice.learn.checkpoints.trained_on import GIVEN, TRAINED_ON, TrainedOn
from hotice.learn.checkpoints.widen import columns_within, widen
from hotice.learn.ppo.dual_ppo import DualPpo
from hotice.learn.ppo.gae import gae
from hotice.learn.ppo.learner import Learner
from hotice.learn.ppo.networks import ActorCritic
from hotice.learn.ppo.storage import Rollout
from hotice.learn.train.config import TrainConfig
from hotice.learn.train.curriculum import SceneCurriculum, Stages
from hotice.learn.train.progress import Progress
from hotice.learn.train.statistics import EpisodeStatistics
from hotice.model.scene_sets import resolve_item
from hotice.policy.policy_file import check_layout
from hotice.sim.env import TransportEnv
from hotice.sim.observations import mirror_action
from hotice.sim.physics.threads import use_threads
from hotice.version import source_version


class Runner:
    """Runner of one training; checkpoints hold all that later updates depend on, so resuming is exact to the bit."""

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
        self.anew = ""
        self._saved_at = time.monotonic()
        self.obs, self.critic_obs = env.reset()
        # The first episodes end at different times, so that a rollout holds all phases of an episode.
        env.memory.step.copy_(
            torch.randint(0, env.config.max_steps, (env.num_envs,), generator=env.generator, device=env.device)
        )
        if config.init is not None:
            self.load_learner(config.init)
        if config.resume and list_checkpoints(config.out):
            self.load(config.out)

    def _make_learner(self, generator: torch.Generator) -> Learner:
        return DualPpo(self.net, self.config.ppo, self.env.policy_table.mirror, mirror_action, generator)

    def train(self) -> bool:
        """Runs until the limit of updates or minutes; saves at the end, also when interrupted: then False.

        Raises `OutputError` where the folder holds another run: its checkpoints would outlive the new ones.
        """
        cfg = self.config
        if not (cfg.resume or self.update) and (there := list_checkpoints(cfg.out)):
            raise OutputError(
                f"{cfg.out}: holds {there[-1].name} of an earlier run: give --resume to go on with it, or another "
                "folder as --out"
            )
        begin, minutes_before = time.monotonic(), self.minutes
        leads = distributed.rank() == 0
        if leads:
            write_config(cfg)
        shown = Progress(cfg, self.update) if leads else contextlib.nullcontext()
        late = stopped = False
        skipped = self.algo.skipped
        with shown as progress, stop_on_signals() as signalled:
            if progress and self.anew:
                progress.note(self.anew)
            while self.update < cfg.updates and not (late or stopped):
                log = self.learn_once()
                self.minutes = minutes_before + (time.monotonic() - begin) / 60.0
                late = cfg.max_minutes > 0 and self.minutes - minutes_before >= cfg.max_minutes
                stopped, late, due = distributed.any_rank(signalled.is_set(), late, self._due())
                if progress:
                    progress.report(self.update, self.steps, self.minutes, log)
                    if self.algo.skipped > skipped:
                        progress.note(f"update {self.update}: left out minibatches whose gradients were not finite")
                skipped = self.algo.skipped
                if due and not (late or stopped):
                    self.save()
            if progress and stopped:
                progress.note("asked to stop: saving")
        self.save()
        return not stopped

    def learn_once(self) -> dict[str, float]:
        """One rollout and one update."""
        begin, unstable = time.monotonic(), self.env.unstable
        self.collect()
        check_physics(self.env.unstable - unstable, self.env.num_envs, self.update + 1, self.config.out)
        middle = time.monotonic()
        self.algo.train_actors(self.update >= self.config.critic_updates)
        log = self.algo.update(self.rollout)
        self._observe_statistics()
        self.average.update(self.net)
        self.update += 1
        check_network(self.net, self.update, self.config.out)
        steps = distributed.size() * self.env.num_envs * self.config.ppo.steps
        self.steps += steps
        distributed.add_up(self.stats.counters)
        episodes, ended, successes = self.stats.pop()
        log |= episodes
        if self.config.curriculum:
            self.curriculum.update(ended, successes)
            self.env.starter.scene_weight.copy_(self.curriculum.weights())
            log["curriculum/solved"] = float((self.curriculum.rate > 0.8).float().mean())
        self.stages.update(float(ended.sum()), float(successes.sum()))
        log |= self.stages.log()
        log["seconds/collect"], log["seconds/learn"] = middle - begin, time.monotonic() - middle
        log["steps_per_s"] = steps / (time.monotonic() - begin)
        log["reward"] = float(self.rollout.reward.mean())
        log |= {f"term/{name}": value for name, value in self.terms.items()}
        log["unstable"] = float(self.env.unstable)
        return log

    @torch.no_grad()
    def collect(self) -> None:
        """Fills the rollout and estimates advantages."""
        net, env, r = self.net, self.env, self.rollout
        terms = torch.zeros(len(env.rewards.names), device=env.device)
        for t in range(self.config.ppo.steps):
            step = env.step(self._act(t))
            r.reward[t], r.terminated[t], r.truncated[t] = step.reward, step.terminated, step.truncated
            if step.truncated.any():
                ids = torch.nonzero(step.truncated).squeeze(1)
                r.final_value[t, ids] = net.values(net.critic_norm(step.final_critic[ids]))
            self.obs, self.critic_obs = step.policy, step.critic
            self.stats.add(step)
            terms += step.terms.mean(dim=0)
        self.terms = dict(zip(env.rewards.names, (terms / self.config.ppo.steps).tolist(), strict=True))
        last = net.values(net.critic_norm(self.critic_obs))
        ppo = self.config.ppo
        r.advantage = gae(r.reward, r.value, last, r.final_value, r.terminated, r.truncated, ppo.gamma, ppo.lam)

    def _act(self, t: int) -> Tensor:
        """Writes what the agents saw and did into row t of the rollout; returns the actions (N, 20)."""
        net, r = self.net, self.rollout
        r.obs[t], r.critic_obs[t] = net.obs_norm(self.obs), net.critic_norm(self.critic_obs)
        r.value[t] = net.values(r.critic_obs[t])
        r.action[t], r.mean[t], r.log_prob[t] = self.algo.sample(r.obs[t])
        return r.action[t]

    def _observe_statistics(self) -> None:
        """Updates the normalisers, once an update, with the newest observations and their mirror images."""
        env = self.env
        obs, critic_obs = distributed.concatenate(self.obs), distributed.concatenate(self.critic_obs)
        self.net.obs_norm.update(torch.cat([obs, env.policy_table.mirror(obs)]))
        self.net.critic_norm.update(torch.cat([critic_obs, env.critic_table.mirror(critic_obs)]))

    # saving and loading ---------------------------------------------------------------------------------------------

    def _due(self) -> bool:
        every = self.config.checkpoint_updates
        late = time.monotonic() - self._saved_at > 60.0 * self.config.checkpoint_minutes
        return late or bool(every and self.update % every == 0)

    def save(self) -> None:
        """Writes a checkpoint: what all ranks share, and each rank's own (`rankN.` before the names from rank 1 on)."""
        own = {f"env.{k}": v for k, v in self.env.state().items()} | self.algo.own_state()
        own |= {"reached": self.stats.reached, "touched": self.stats.touched}
        first, *others = distributed.collect(own)
        tensors = {f"net.{k}": v for k, v in self.net.state_dict().items()} | self.algo.state() | first
        tensors |= self.average.state()
        tensors |= {f"rank{r}.{k}": v for r, other in enumerate(others, 1) for k, v in other.items()}
        tensors["curriculum"] = self.curriculum.rate
        tensors |= self.stages.state()
        meta: dict[str, Any] = {
            **self.algo.meta(),
            "steps": self.steps,
            "minutes": self.minutes,
            "config": config_to_dict(self.config),
            "layout": self.env.policy_table.layout(),
            "critic_layout": self.env.critic_table.layout(),
            "scenes": self.env.bank.names,
            "source": source_version(),
            ANCESTORS: self.ancestors,
            TRAINED_ON: self.trained_on.to_json(),
            "num_envs": self.env.num_envs,
            "ranks": distributed.size(),
        }
        self._saved_at = time.monotonic()
        if distributed.rank() == 0:
            save_checkpoint(self.config.out, self.update, tensors, meta)

    def load(self, path: Path) -> None:
        """Restores a run from its newest checkpoint. Raises `CheckpointError` when it does not fit this one.

        With other ranks, environments, scenes, task or perturbations episodes begin again; `anew` holds the message.
        """
        tensors, meta = load_checkpoint(path, self.env.device)
        with _same_version(path):
            self._restore_run(path, tensors, meta)

    def _restore_run(self, path: Path, tensors: dict[str, Tensor], meta: dict[str, Any]) -> None:
        if kind_of(meta) != self.algo.kind:
            raise CheckpointError(
                f"{path}: was trained by {kind_of(meta)!r}, not {self.algo.kind!r}: give another folder as out, or it "
                "as init"
            )
        self._load_net(path, tensors, meta)
        self.average.restart(self.net)
        self.average.load_state(tensors)
        self.algo.load_state(tensors, meta)
        self.update, self.steps, self.minutes = int(meta["update"]), int(meta["steps"]), float(meta["minutes"])
        self.ancestors = dict(meta.get(ANCESTORS, {}))
        self.trained_on = TrainedOn.of_meta(meta, str(path)) | self.trained_on
        if MERGED in meta:  # its first part, whose counters go on
            self.ancestors.pop(meta[MERGED][0]["sha256"], None)
        self.stages.load_state(tensors)
        self._keep_rates(tensors["curriculum"], meta["scenes"])
        ranks = meta.get("ranks", 1)
        pairs = {
            "ranks": (ranks, distributed.size()),
            "num_envs": (meta["num_envs"], self.env.num_envs),
            "scenes": (meta["scenes"], self.env.bank.names),
            "task": (meta["config"]["task"], config_to_dict(self.config)["task"]),
            "perturbed": (meta["config"].get("perturbed", False), self.config.perturbed),
        }
        if others := [name for name, (theirs, ours) in pairs.items() if theirs != ours]:
            kept = sum(name in meta["scenes"] for name in self.env.bank.names)
            self.anew = (
                f"{path}: was saved with other {', '.join(others)}: episodes start anew, {kept} of "
                f"{self.env.bank.num_scenes} scenes keep their success rates"
            )
        if ranks != distributed.size():
            return
        prefix = f"rank{distributed.rank()}."
        tensors = tensors | {k.removeprefix(prefix): v for k, v in tensors.items() if k.startswith(prefix)}
        self.algo.load_own_state(tensors)
        if not others:
            self.obs, self.critic_obs = self.env.load_state(
                {k.removeprefix("env."): v for k, v in tensors.items() if k.startswith("env.")}
            )
            self.stats.reached.copy_(tensors["reached"])
            self.stats.touched.copy_(tensors["touched"])

    def _keep_rates(self, rates: Tensor, names: list[str]) -> None:
        """Takes over the success rates of the scenes that this run has too; others begin as in a new run."""
        ours, theirs = self.env.bank.names, dict(zip(names, rates, strict=True))
        known = list(rates) if ours == names else [theirs.get(name) for name in ours]  # a scene may be there twice
        for i, rate in enumerate(known):
            if rate is not None:
                self.curriculum.rate[i] = rate
        if self.config.curriculum:
            self.env.starter.scene_weight.copy_(self.curriculum.weights())

    def load_learner(self, path: Path) -> None:
        """Takes networks and normalisers of another run, and its optimiser where that served the same objective.

        The actors begin at their average, where the run kept one.

        Inputs that hardly varied in that run (the distance to obstacles on an open floor) get zero weights and an
        ordinary
        variance: the old skill stays what it was when they begin to vary. Rows that its observation did not have (scan,
        history) begin with zero weights too.
        """
        tensors, meta = load_checkpoint(path, self.env.device)
        with _same_version(path):
            check_weights(path, tensors)
            self.ancestors |= line_of(meta)
            self.trained_on = TrainedOn.of_meta(meta, str(path)) | self.trained_on
            tensors, meta = self._widened(averaged(tensors), meta)
            self._load_net(path, tensors, meta)
            if kind_of(meta) == self.algo.kind:
                self.algo.load_optimizer(tensors, meta)
        for norm, kind in ((self.net.obs_norm, "actor"), (self.net.critic_norm, "critic")):
            constant = norm.var < 1e-5
            norm.var[constant] = 0.1
            for agent in self.net.agents:
                first = getattr(self.net.nets[agent.name], kind)[0]
                with torch.no_grad():
                    first.weight[:, constant] = 0.0
        self.average.restart(self.net)

    def _widened(self, tensors: dict[str, Tensor], meta: dict[str, Any]) -> tuple[dict[str, Tensor], dict[str, Any]]:
        """A checkpoint for this environment's observation, where that only adds rows to the checkpoint's."""
        env = self.env
        for key, table, norm, net in (
            ("layout", env.policy_table, "obs_norm", "actor"),
            ("critic_layout", env.critic_table, "critic_norm", "critic"),
        ):
            old, new = [(name, width) for name, width in meta[key]], table.layout()
            if columns_within(old, new) is not None:
                tensors, meta = widen(tensors, old, new, norm, net), {**meta, key: new}
        return tensors, meta

    def _load_net(self, path: Path, tensors: dict[str, Tensor], meta: dict[str, Any]) -> None:
        self._check_fit(path, meta)
        check_weights(path, tensors)
        try:
            self.net.load_state_dict({k.removeprefix("net."): v for k, v in tensors.items() if k.startswith("net.")})
        except RuntimeError as error:
            raise CheckpointError(f"{path}: networks of another shape: {str(error).splitlines()[-1].strip()}") from None

    def _check_fit(self, path: Path, meta: dict[str, Any]) -> None:
        check_layout(str(path), meta["layout"], self.env.policy_table.layout())
        theirs, ours = meta["config"]["preset"], self.config.preset
        if theirs != ours:
            raise CheckpointError(f"{path}: was trained as {theirs!r}, not {ours!r}: give --preset {theirs}")
        sizes = {name: [int(n) for n in meta["config"][name]] for name in ("hidden", "critic_hidden")}
        if any(list(getattr(self.config, name)) != given for name, given in sizes.items()):
            mend = " ".join(f"--{name.replace('_', '-')} {' '.join(map(str, given))}" for name, given in sizes.items())
            raise CheckpointError(f"{path}: its networks have hidden layers of other sizes: give {mend}")


def kind_of(meta: dict[str, Any]) -> str:
    """What trained a checkpoint; before distillation there was only one way."""
    return meta.get("learner", DualPpo.kind)


@contextlib.contextmanager
def _same_version(path: Path) -> Iterator[None]:
    try:
        yield
    except (KeyError, IndexError, TypeError, ValueError, RuntimeError) as error:
        if ran_out_of_memory(error):
            raise
        reason = f"{type(error).__name__} {error}".splitlines()[-1].strip()
        raise CheckpointError(f"{path}: is no checkpoint of this version: {reason}") from error


@contextlib.contextmanager
def stop_on_signals() -> Iterator[threading.Event]:
    """An event that is set by the first SIGINT or SIGTERM; the second one acts as it did before."""
    event = threading.Event()
    if threading.current_thread() is not threading.main_thread():
        yield event
        return
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}

    def stop(number: int, frame: FrameType | None) -> None:
        event.set()
        for each, handler in before.items():
            signal.signal(each, handler)

    for number in before:
        signal.signal(number, stop)
    try:
        yield event
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def config_to_dict(config: Any) -> Any:
    """A configuration as JSON-ready values."""
    return json.loads(json.dumps(dataclasses.asdict(config), default=str))


def write_config(config: TrainConfig) -> None:
    """Writes `config.json` of a run, aside and renamed. Raises `OutputError`."""
    content = {**config_to_dict(config), "source": source_version()}
    write_text(make_folder(config.out) / "config.json", json.dumps(content, indent=1) + "\n")
