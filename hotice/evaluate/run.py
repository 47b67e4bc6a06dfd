"""Scoring a policy or the walking baseline: success rate and mean distance, with exact collision geometry (paper, V-A).

A trial ends at success, at a failure, or after 5 s. Success: the root comes within 0.1 m (horizontally) of the goal
before any fall, drop or collision of robot or object. Mean distance: root to goal at the end of each trial, averaged.
Every link of the robot and the object are tested against every obstacle geometry in the simulator, in every physics
step. The simulation goes on beyond that end, for other referees and for where the robot is at 5 s:
`hotice.evaluate.referees`.

The unit of work is a block: up to `batch` trials of one scene, simulated on one thread, a policy's side by side, with
random numbers of its own (`hotice.evaluate.seeds`): the same objects, robots and starts whoever carries. Blocks are
shared out to processes; results depend neither on their number nor on interruptions, nor on the other scenes. They do
depend on `batch`: what happens to the trials of a block is drawn for all of them at once.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

import torch

from hotice import checks
from hotice.checks import Range
from hotice.control.walk.config import WalkConfig
from hotice.errors import InvalidConfig, UnknownName
from hotice.evaluate.carriers import CONTROLLERS, Carrier, digest, load_carrier
from hotice.evaluate.conditions import Conditions, start_trials
from hotice.evaluate.referees import REFEREES, check_referees
from hotice.evaluate.report import make_report, print_report
from hotice.evaluate.seeds import TrialSeeds, object_seed
from hotice.evaluate.trial_log import TrialLog
from hotice.evaluate.trials import Trials, TrialStore
from hotice.files import check_writable, write_text
from hotice.learn.policy import Policy, check_layout
from hotice.model.carry import CarryState
from hotice.model.object_range import ObjectRange
from hotice.model.scene import Scene
from hotice.model.scene_digest import scene_digest
from hotice.sim.carry_bank import CarryBank
from hotice.sim.env import TransportEnv
from hotice.sim.physics.mujoco_batch import MujocoBatch
from hotice.sim.physics.ram import check_memory
from hotice.sim.physics.threads import one_thread
from hotice.version import source_version

LONGEST_S = 120.0


@dataclass(frozen=True, kw_only=True)
class EvaluateConfig:
    """One evaluation."""

    policy: str | None = None
    """Shipped policy by name, .onnx file, checkpoint folder or run; needed with, and only with, `policy` as the
    controller."""
    controller: Literal["policy", "walk"] = "policy"
    """Who carries: a policy, or the model-based walking baseline, which reads the exact state (needs --no-perturbed,
    and the packages of the extra `drake`)."""
    scenes: tuple[str, ...]
    """Scene names, sets (bench20, unseen50), files, folders, or families as `family:NAME:COUNT`."""
    rollouts: int = 100
    """Trials a scene."""
    seed: int = 0
    """Seed of objects, starts and perturbations."""
    out: Path | None = None
    """Report file (JSON); none: only print. What is done is kept in the folder OUT.trials beside it, and an evaluation
    of the same policy, scenes and settings goes on from there."""
    batch: int = 250
    """Trials that one process takes at a time: a policy's are simulated side by side."""
    threads: int = 0
    """Processes, each on one core; 0: one for each core."""
    protocol: Literal["robot", "paper"] = "robot"
    """`robot`: 2 ms physics with converged elliptic cones, palms 0.6 to 1.2, soles 0.5 to 1.2, torso's centre of mass ±
    10 cm; `paper`: 5 ms physics with pyramids, palms 2.0, soles 0.8 to 1.2, ± 5 cm, to compare with the paper's
    tables."""
    perturbed: bool = True
    """Noise, delays, pushes and uncertain dynamics of the protocol."""
    without: tuple[str, ...] = ()
    """Of these, what is switched off, to see what it costs: sensor-noise, object-noise, delay, root-rate, pushes,
    dynamics."""
    shapes: tuple[str, ...] = ("box",)
    """Shapes of the carried objects."""
    size_m: tuple[float, float] = (0.20, 0.40)
    """Smallest and largest extent of the objects."""
    mass_kg: tuple[float, float] = (0.5, 3.5)
    """Lightest and heaviest object."""
    objects: int = 256
    """Different objects, shared by all scenes; no more than `rollouts`. Each scene has an order of its own."""
    horizon_s: float = 5.0
    """Time limit of a trial (paper: 5 s)."""
    referees: tuple[str, ...] = REFEREES
    """Who judges the same trials: `exact`, contacts of the full geometry, whose verdicts the rates of a report are;
    `points`, eleven points of the body and eight of the object, beside it. `exact` alone is faster: a contact then ends
    a trial."""

    def __post_init__(self) -> None:
        self._check_carrier()
        horizon = Range(least=0.02, most=LONGEST_S, unit="s", note="0.02: a control step")
        checks.number("horizon_s", self.horizon_s, horizon)
        checks.wholes(self, checks.COUNT, "rollouts", "batch", "objects")
        checks.wholes(self, checks.INT64, "seed", "threads")
        if not self.scenes:
            raise InvalidConfig("no scenes: at least one name, file or folder is needed")
        check_referees(self.referees)
        _ = self.conditions
        if self.without and not self.perturbed:
            raise InvalidConfig(
                f"without is {', '.join(self.without)}: nothing is left to switch off with --no-perturbed"
            )

    @property
    def conditions(self) -> Conditions:
        """Physics, perturbation and time limit."""
        return Conditions(
            protocol=self.protocol, perturbed=self.perturbed, without=self.without, horizon_s=self.horizon_s
        )

    @property
    def judges(self) -> tuple[str, ...]:
        """The referees, in the order of `REFEREES`."""
        return tuple(name for name in REFEREES if name in self.referees)

    def _check_carrier(self) -> None:
        if self.controller not in CONTROLLERS:
            raise UnknownName("controller", self.controller, CONTROLLERS)
        if self.controller == "policy" and self.policy is None:
            raise InvalidConfig("no policy: give one as --policy NAME or PATH, or --controller walk")
        if self.controller == "walk" and self.policy is not None:
            raise InvalidConfig(
                f"policy is {self.policy!r} and controller is 'walk', which has no policy: leave out one of the two"
            )
        if self.controller == "walk" and self.perturbed:
            raise InvalidConfig(
                "perturbed is True: the walking baseline reads the exact state, it is not evaluated under noise, delays and "
                "pushes: give --no-perturbed, also to the policies that it is compared with"
            )


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
    log = TrialLog(env.bank, len(states), conditions.limit(env.config), env.config.control_dt_s, judges)
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
        from hotice.model.scene_sets import resolve_scenes

        scenes = resolve_scenes(config.scenes)
        check_memory(min(config.batch, config.rollouts), config.rollouts * len(scenes))
        ranges = ObjectRange(shapes=config.shapes, size_m=config.size_m, mass_kg=config.mass_kg)
        count = min(config.objects, config.rollouts)
        states = CarryBank.sample(ranges, count, object_seed(config.seed), 0.005, torch.device("cpu")).states
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
        """What the trials depend on, JSON-ready: only trials of equal settings may be joined."""
        ignored = ("out", "threads", "policy", "scenes")
        config = {k: v for k, v in asdict(self.config).items() if k not in ignored}
        settings = {
            **config,
            "referees": self.config.judges,
            "carrier": digest(carrier),
            "source": source_version(),
            "scenes": [scene_digest(scene) for scene in self.scenes],
        }
        return json.loads(json.dumps(settings))


def evaluate(config: EvaluateConfig) -> dict[str, Any]:
    """Scores a policy, or the walk, on scenes, prints a table, writes the report; returns it. Raises `HoticeError`."""
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    from hotice.evaluate.processes import score_blocks

    carrier = load_carrier(config)
    if config.out is not None:
        check_writable(config.out)
    scorer = Scorer.of(config)
    names = [scene.name for scene in scorer.scenes]
    console = Console(stderr=True)
    done: dict[tuple[int, int], Trials] = {}
    store = None
    if config.out is not None:
        store = TrialStore(Path(f"{config.out}.trials"), scorer.settings(carrier), names)
        done = store.blocks
        if store.changed:
            console.print(
                f"{store.folder} was made with another {', '.join(store.changed)}: starting anew", highlight=False
            )
        elif done:
            console.print(
                f"{len(done)} of {len(scorer.blocks())} blocks are in {store.folder}: going on", highlight=False
            )
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        before = sum(trials.rollouts for trials in done.values())
        task = progress.add_task("trials", total=config.rollouts * len(names), completed=before)
        left = [block for block in scorer.blocks() if block not in done]
        for (scene, block), trials in score_blocks(
            scorer, carrier, left, config.threads, lambda n: progress.update(task, completed=before + n)
        ):
            done[scene, block] = trials
            if store is not None:
                store.add(scene, block, trials)
    blocks = [[done[key] for key in scorer.blocks() if key[0] == scene] for scene in range(len(names))]
    scores = [(name, Trials.joined(parts)) for name, parts in zip(names, blocks, strict=True)]
    report = make_report(carrier, config, scores)
    if config.out is not None:
        write_text(config.out, json.dumps(report, indent=1) + "\n")
    print_report(report, Console(width=None if Console().is_terminal else 130))
    return report
