"""Scoring a policy or the walking baseline: success rate and mean distance, with exact collision geometry (paper, V-A).

A trial ends at success, at a failure, or after 5 s. Success: the root comes within 0.1 m (horizontally) of the goal before
any fall, drop or collision of robot or object. Mean distance: root to goal at the end of each trial, averaged.
Every link of the robot and the object are tested against every obstacle geometry in the simulator, in every physics step.

The unit of work is a block: up to `batch` trials of one scene, simulated on one thread, a policy's side by side, with random
numbers of its own: the same objects and starts whoever carries. Blocks are shared out to processes; results depend neither on
their number nor on interruptions.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch

from hotice.control.walk.config import WalkConfig
from hotice.errors import InvalidConfig, UnknownName
from hotice.fields.bank import FieldBank
from hotice.files import check_writable, write_text
from hotice.learn.carriers import CONTROLLERS, Carrier, digest, load_carrier
from hotice.learn.policy import Policy, check_layout
from hotice.learn.report import make_report, print_report
from hotice.learn.trials import Trials, TrialStore
from hotice.learn.version import source_version
from hotice.model.carry import CarryState
from hotice.model.object_range import ObjectRange
from hotice.model.scene import Scene
from hotice.model.scene_digest import scene_digest
from hotice.sim.carry_bank import CarryBank
from hotice.sim.config import TaskConfig
from hotice.sim.env import TransportEnv
from hotice.sim.memory import check_memory
from hotice.sim.mujoco_batch import MujocoBatch
from hotice.sim.perturbations import without as switch_off
from hotice.sim.terminations import OUTCOMES
from hotice.sim.threads import one_thread

CPU = torch.device("cpu")
LONGEST_S = 120.0
FINE_DT_S = 0.002
BLOCKS, OBJECTS = 101, 102
"""Streams of random numbers that no training draws from."""


@dataclass(frozen=True, kw_only=True)
class EvaluateConfig:
    """One evaluation."""

    policy: str | None = None
    """Shipped policy by name, .onnx file, checkpoint folder or run; needed with, and only with, `policy` as the controller."""
    controller: Literal["policy", "walk"] = "policy"
    """Who carries: a policy, or the model-based walking baseline, which reads the exact state (needs --no-perturbed, and the
    packages of the extra `drake`)."""
    scenes: tuple[str, ...]
    """Scene names, sets (bench20, unseen50), files, folders, or families as `family:NAME:COUNT`."""
    rollouts: int = 100
    """Trials a scene."""
    seed: int = 0
    """Seed of objects, starts and perturbations."""
    out: Path | None = None
    """Report file (JSON); none: only print. What is done is kept in the folder OUT.trials beside it, and an evaluation of the
    same policy, scenes and settings goes on from there."""
    batch: int = 250
    """Trials that one process takes at a time: a policy's are simulated side by side."""
    threads: int = 0
    """Processes, each on one core; 0: one for each core."""
    fine: bool = False
    """Simulate with 2 ms steps and elliptic friction cones instead of the training settings."""
    perturbed: bool = True
    """Noise, delays, pushes and uncertain dynamics as in the training of students."""
    without: tuple[str, ...] = ()
    """Of these, what is switched off, to see what it costs: sensor-noise, object-noise, delay, root-rate, pushes, dynamics."""
    shapes: tuple[str, ...] = ("box",)
    """Shapes of the carried objects."""
    size_m: tuple[float, float] = (0.20, 0.40)
    """Smallest and largest extent of the objects."""
    mass_kg: tuple[float, float] = (0.5, 3.5)
    """Lightest and heaviest object."""
    objects: int = 256
    """Different objects, shared by all scenes; no more than `rollouts`. Trials with the same object have the same robot too."""
    horizon_s: float = 5.0
    """Time limit of a trial (paper: 5 s)."""

    def __post_init__(self) -> None:
        self._check_carrier()
        if not 0.02 <= self.horizon_s <= LONGEST_S:  # also false for NaN
            raise InvalidConfig(f"horizon_s is {self.horizon_s!r}: 0.02 (a control step) to {LONGEST_S:g} are allowed")
        for name in ("rollouts", "batch", "objects"):
            if getattr(self, name) < 1:
                raise InvalidConfig(f"{name} is {getattr(self, name)!r}: at least 1 is needed")
        for name in ("seed", "threads"):
            if not 0 <= getattr(self, name) < 2**63:
                raise InvalidConfig(f"{name} is {getattr(self, name)!r}: 0 to 2^63 - 1 is needed")
        if not self.scenes:
            raise InvalidConfig("no scenes: at least one name, file or folder is needed")
        switch_off(TaskConfig(), self.without)
        if self.without and not self.perturbed:
            raise InvalidConfig(
                f"without is {', '.join(self.without)}: nothing is left to switch off with --no-perturbed"
            )

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


def evaluation_task(
    task: dict[str, Any],
    *,
    fine: bool = False,
    perturbed: bool = False,
    without: Sequence[str] = (),
    horizon_s: float = 5.0,
) -> TaskConfig:
    """The task a policy was trained on, with the paper's trial: 5 s, from the scene's start, over at the goal.

    `without`: sources of perturbation that are switched off. Raises `UnknownName`.
    """
    known = TaskConfig()
    kept = (
        "leg_scale_rad", "arm_scale_rad", "action_limit", "speed_m_s", "stop_gain_hz", "gait_hz", "swing_height_m",
        "resolution_m", "margin_m", "scan", "history", "physics_dt_s", "substeps",
    )  # fmt: skip
    values = {k: task[k] for k in kept if k in task}
    if fine:
        values |= _finer(replace(known, **{k: values[k] for k in ("physics_dt_s", "substeps") if k in values}))
    known = switch_off(known.perturbed() if perturbed else known, without)
    return replace(
        known, **values, episode_s=horizon_s, goal_radius_m=0.1, anywhere=0.0, end_at_goal=True, collisions=True,
        start_noise_m=0.03, start_yaw_noise_rad=0.1,
    )  # fmt: skip


def _finer(task: TaskConfig) -> dict[str, Any]:
    """Physics steps of `FINE_DT_S` or a little less in the same control period."""
    substeps = math.ceil(task.control_dt_s / FINE_DT_S - 1e-9)
    return {"physics_dt_s": task.control_dt_s / substeps, "substeps": substeps}


def start_trials(
    scene: Scene, states: Sequence[CarryState], rollouts: int, seed: int, config: TaskConfig, *, first: int = 0,
    fine: bool = False, preset: str = "dual_hodpf",
) -> TransportEnv:  # fmt: skip
    """Trials `first` .. `first + rollouts` of a scene, to be started by `reset`; every carry state is used in turn.

    Objects and starts depend on the seed alone, not on who carries.
    """
    bank = _fields(scene, config.resolution_m, config.margin_m)
    carry = CarryBank.of(
        states, config.physics_dt_s, CPU, scene=scene, elliptic=fine, dynamics=config.dynamics, seed=seed
    )
    env = TransportEnv(rollouts, bank, carry, preset, seed=seed, config=config, threads=1)
    env.memory.model[:] = (torch.arange(rollouts) + first) % len(states)
    return env


def score_block(
    policy: Policy, scene: Scene, states: Sequence[CarryState], rollouts: int, seed: int, *, first: int = 0,
    fine: bool = False, perturbed: bool = True, without: Sequence[str] = (), horizon_s: float = 5.0,
    on_trials: Callable[[int], None] | None = None,
) -> Trials:  # fmt: skip
    """Runs a policy in trials `first` .. `first + rollouts` of a scene side by side, see `start_trials`.

    `on_trials(n)` is called when n more trials have ended. Raises `CheckpointError` for a policy of another observation.
    """
    meta = policy.meta
    config = evaluation_task(meta["task"], fine=fine, perturbed=perturbed, without=without, horizon_s=horizon_s)
    env = start_trials(scene, states, rollouts, seed, config, first=first, fine=fine, preset=meta["preset"])
    check_layout(policy, env.policy_table.layout())
    obs, _ = env.reset()
    outcome, steps = (torch.zeros(rollouts, dtype=torch.int64) for _ in range(2))
    distance_m = torch.zeros(rollouts)
    while (outcome == 0).any():
        step = env.step(policy.act(obs))
        obs = step.policy
        ended = (outcome == 0) & (step.outcome > 0)
        outcome[ended], steps[ended], distance_m[ended] = (
            step.outcome[ended], step.length[ended], step.goal_distance[ended]
        )  # fmt: skip
        if ended.any():
            let_rest(env, outcome == 0)
        if on_trials:
            on_trials(int(ended.sum()))
    return Trials(
        outcome=tuple(OUTCOMES[i] for i in outcome.tolist()), distance_m=tuple(distance_m.tolist()),
        time_s=tuple(round(n * config.control_dt_s, 6) for n in steps.tolist()),
    )  # fmt: skip


def let_rest(env: TransportEnv, running: torch.Tensor) -> None:
    """Trials that are over stand still from now on: half of an evaluation's physics would be theirs. `running` (N,) bool."""
    if isinstance(env.physics, MujocoBatch):
        env.physics.only = torch.nonzero(running).squeeze(1)


@lru_cache(maxsize=1)
def _fields(scene: Scene, resolution_m: float, margin_m: float) -> FieldBank:
    """Fields of one scene, kept for its next block."""
    return FieldBank.build([scene], resolution_m, margin_m, workers=1)


def block_seed(seed: int, block: int) -> int:
    """Seed of a block's random numbers, other than those of a training with the same `seed`."""
    return _derived(seed, BLOCKS, block)


def _derived(*numbers: int) -> int:
    return int(np.random.SeedSequence(numbers).generate_state(1, np.uint32)[0])


@dataclass(frozen=True, kw_only=True)
class Scorer:
    """Everything that processes need to score blocks: the evaluation, its scenes and its objects."""

    config: EvaluateConfig
    scenes: tuple[Scene, ...]
    states: tuple[CarryState, ...]

    @classmethod
    def of(cls, config: EvaluateConfig) -> Scorer:
        """Resolves the scenes and draws the objects. Raises `HoticeError`."""
        from hotice.learn.scene_sets import resolve_scenes

        scenes = resolve_scenes(config.scenes)
        check_memory(min(config.batch, config.rollouts), config.rollouts * len(scenes))
        ranges = ObjectRange(shapes=config.shapes, size_m=config.size_m, mass_kg=config.mass_kg)
        states = CarryBank.sample(
            ranges, min(config.objects, config.rollouts), _derived(config.seed, OBJECTS), 0.005, CPU
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
        which = (self.scenes[scene], self.states, self.size(block), block_seed(cfg.seed, block))
        with one_thread():
            if isinstance(carrier, WalkConfig):
                from hotice.learn.walk_trials import score_walks

                task = evaluation_task({}, fine=cfg.fine, horizon_s=cfg.horizon_s)
                env = start_trials(*which, task, first=first, fine=cfg.fine)
                env.reset()
                return score_walks(carrier, env, first=first, on_trials=on_trials)
            return score_block(
                carrier, *which, first=first, fine=cfg.fine, perturbed=cfg.perturbed, without=cfg.without,
                horizon_s=cfg.horizon_s, on_trials=on_trials,
            )  # fmt: skip

    def settings(self, carrier: Carrier) -> dict[str, Any]:
        """What the trials depend on, JSON-ready: only trials of equal settings may be joined."""
        ignored = ("out", "threads", "policy", "scenes")
        config = {k: v for k, v in asdict(self.config).items() if k not in ignored}
        settings = {
            **config, "carrier": digest(carrier), "source": source_version(),
            "scenes": [scene_digest(scene) for scene in self.scenes],
        }  # fmt: skip
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

    from hotice.learn.score_processes import score_blocks

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
        TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TimeRemainingColumn()
    )  # fmt: skip
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
