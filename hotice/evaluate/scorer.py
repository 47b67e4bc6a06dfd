"""Blocks of trials, the unit of work of an evaluation, and everything that scoring them needs.

A block is up to `batch` trials of one scene, simulated on one thread, a policy's side by side, with random numbers of
its own (`hotice.evaluate.seeds`): the same objects, robots and starts whoever carries. Results depend neither on the
number of processes nor on interruptions, nor on the other scenes. They do depend on `batch`: what happens to the trials
of a block is drawn for all of them at once.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import torch

from hotice.control.walk.config import WalkConfig
from hotice.evaluate.carriers import Carrier, digest
from hotice.evaluate.conditions import Conditions
from hotice.evaluate.config import EvaluateConfig
from hotice.evaluate.referees import REFEREES
from hotice.evaluate.seeds import TrialSeeds, object_seed
from hotice.evaluate.start import start_trials
from hotice.evaluate.trial_log import TrialLog
from hotice.evaluate.trials import Trials
from hotice.learn.policy import Policy, check_layout
from hotice.model.carry import CarryState
from hotice.model.moving.still import only_still
from hotice.model.scene import Scene
from hotice.model.scene_digest import scene_digest
from hotice.model.shipped import resolve_scenes
from hotice.sim.carry_bank import CarryBank
from hotice.sim.env import TransportEnv
from hotice.sim.physics.mujoco_batch import MujocoBatch
from hotice.sim.physics.ram import check_memory
from hotice.sim.physics.threads import one_thread
from hotice.version import source_version


def score_block(
    policy: Policy,
    scene: Scene,
    states: Sequence[CarryState],
    seed: int,
    conditions: Conditions,
    *,
    first: int = 0,
    judges: Sequence[str] = REFEREES,
    on_trials: Callable[[int], None] | None = None,
) -> Trials:
    """Runs a policy in trials `first` .. `first + len(states)` of a scene side by side, see `start_trials`.

    `judges`: referees. `on_trials(n)` is called when n more trials are over. Raises `CheckpointError` for a policy of
    another observation.
    """
    meta = policy.meta
    env = start_trials(scene, states, seed, conditions, first=first, trained=meta["task"], preset=meta["preset"])
    check_layout(policy, env.policy_table.layout())
    log = TrialLog(env.bank, len(states), conditions.limit(env.config), env.config.control_dt_s, judges, env.moving)
    obs, _ = env.reset()
    while log.running.any():
        step = env.step(policy.act(obs))
        obs = step.policy
        ended = log.see_step(step)
        if ended:
            let_rest(env, torch.from_numpy(log.running))
        if on_trials:
            on_trials(ended)
    return log.trials()


def let_rest(env: TransportEnv, running: torch.Tensor) -> None:
    """Trials that are over stand still from now on, which saves their physics. `running` (N,) bool."""
    if isinstance(env.physics, MujocoBatch):
        env.physics.only = torch.nonzero(running).squeeze(1)


@dataclass(frozen=True, kw_only=True)
class Scorer:
    """Everything that processes need to score blocks: the evaluation, its scenes and its objects."""

    config: EvaluateConfig
    scenes: tuple[Scene, ...]
    states: tuple[CarryState, ...]

    @classmethod
    def of(cls, config: EvaluateConfig) -> Scorer:
        """Resolves the scenes and draws the objects. Raises `HoticeError`."""
        scenes = resolve_scenes(config.scenes)
        if config.controller == "walk":
            for scene in scenes:
                only_still(scene, "the walking baseline")
        check_memory(min(config.batch, config.rollouts), config.rollouts * len(scenes))
        count = min(config.objects, config.rollouts)
        states = CarryBank.sample(
            config.object_range, count, object_seed(config.seed), 0.005, torch.device("cpu")
        ).states
        return cls(config=config, scenes=tuple(scenes), states=states)

    def blocks(self) -> list[tuple[int, int]]:
        """(scene, block) of all trials."""
        count = -(-self.config.rollouts // self.config.batch)
        return [(scene, block) for scene in range(len(self.scenes)) for block in range(count)]

    def size(self, block: int) -> int:
        """Trials of a block."""
        return min(self.config.batch, self.config.rollouts - block * self.config.batch)

    def score(self, carrier: Carrier, scene: int, block: int, on_trials: Callable[[int], None] | None = None) -> Trials:
        """Runs a block on one thread."""
        cfg, first = self.config, block * self.config.batch
        place = self.scenes[scene]
        which = TrialSeeds.of(cfg.seed, place).objects(cfg.rollouts, len(self.states))[first:][: self.size(block)]
        asked = (place, [self.states[k] for k in which], cfg.seed, cfg.conditions)
        with one_thread():
            if isinstance(carrier, WalkConfig):
                from hotice.evaluate.walk_trials import score_walks

                return score_walks(carrier, *asked, first=first, judges=cfg.judges, on_trials=on_trials)
            return score_block(carrier, *asked, first=first, judges=cfg.judges, on_trials=on_trials)

    def settings(self, carrier: Carrier) -> dict[str, Any]:
        """Settings that the trials depend on, JSON-ready: only trials of equal settings may be joined."""
        ignored = ("task", "out", "threads", "policy", "scenes")
        config = {k: v for k, v in asdict(self.config).items() if k not in ignored}
        settings = {
            **config,
            "referees": self.config.judges,
            "carrier": digest(carrier),
            "source": source_version(),
            "scenes": [scene_digest(scene) for scene in self.scenes],
        }
        return json.loads(json.dumps(settings))
