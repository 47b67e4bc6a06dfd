"""Scoring a policy: success rate and mean distance, with exact collision geometry (paper, V-A).

A trial ends at success, at a failure, or after 5 s. Success: the root comes within 0.1 m (horizontally) of the goal before
any fall, drop or collision of robot or object. Mean distance: root to goal at the end of each trial, averaged.
Every link of the robot and the object are tested against every obstacle geometry in the simulator, in every physics step.

The unit of work is a block: up to `batch` trials of one scene, simulated side by side on one thread, with random numbers of
its own. Blocks are shared out to processes; results depend neither on their number nor on interruptions.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import torch

from hotice.errors import InvalidConfig
from hotice.fields.bank import FieldBank
from hotice.files import check_writable, write_text
from hotice.learn.policy import Policy, check_layout, load_policy
from hotice.learn.report import make_report, print_report
from hotice.learn.trials import Trials, TrialStore
from hotice.learn.version import source_version
from hotice.model.carry import CarryState
from hotice.model.object_range import ObjectRange
from hotice.model.scene import Scene
from hotice.model.shapes import MeshShape
from hotice.sim.carry_bank import CarryBank
from hotice.sim.config import TaskConfig
from hotice.sim.env import TransportEnv
from hotice.sim.memory import check_memory
from hotice.sim.mujoco_batch import MujocoBatch
from hotice.sim.perturbations import without as switch_off
from hotice.sim.terminations import OUTCOMES
from hotice.sim.threads import one_thread

CPU = torch.device("cpu")


@dataclass(frozen=True, kw_only=True)
class EvaluateConfig:
    """One evaluation."""

    policy: str
    """Shipped policy by name, .onnx file, checkpoint folder or run."""
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
    """Trials simulated side by side by one process."""
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
    objects: int = 32
    """Different objects, shared by all scenes."""

    def __post_init__(self) -> None:
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


def evaluation_task(
    task: dict[str, Any], *, fine: bool = False, perturbed: bool = False, without: Sequence[str] = ()
) -> TaskConfig:
    """The task a policy was trained on, with the paper's trial: 5 s, from the scene's start, over at the goal.

    `without`: sources of perturbation that are switched off. Raises `UnknownName`.
    """
    known = TaskConfig()
    kept = (
        "leg_scale_rad", "arm_scale_rad", "action_limit", "speed_m_s", "stop_gain_hz", "gait_hz", "swing_height_m",
        "resolution_m", "margin_m", "scan",
    )  # fmt: skip
    values = {k: task[k] for k in kept if k in task}
    if fine:
        values |= {"physics_dt_s": 0.002, "substeps": 10}
    known = switch_off(known.perturbed() if perturbed else known, without)
    return replace(
        known, **values, episode_s=5.0, goal_radius_m=0.1, anywhere=0.0, end_at_goal=True, collisions=True,
        start_noise_m=0.03, start_yaw_noise_rad=0.1,
    )  # fmt: skip


def score_block(
    policy: Policy, scene: Scene, states: Sequence[CarryState], rollouts: int, seed: int, *, first: int = 0,
    fine: bool = False, perturbed: bool = True, without: Sequence[str] = (),
    on_trials: Callable[[int], None] | None = None,
) -> Trials:  # fmt: skip
    """Runs trials `first` .. `first + rollouts` of a scene side by side; every carry state is used in turn.

    `on_trials(n)` is called when n more trials have ended. Raises `CheckpointError` for a policy of another observation.
    """
    config = evaluation_task(policy.meta["task"], fine=fine, perturbed=perturbed, without=without)
    bank = _fields(scene, config.resolution_m, config.margin_m)
    carry = CarryBank.of(
        states, config.physics_dt_s, CPU, scene=scene, elliptic=fine, dynamics=config.dynamics, seed=seed
    )
    env = TransportEnv(rollouts, bank, carry, policy.meta["preset"], seed=seed, config=config, threads=1)
    check_layout(policy, env.policy_table.layout())
    env.memory.model[:] = (torch.arange(rollouts) + first) % len(states)
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
    """Seed of a block's random numbers; the first block has the evaluation's."""
    return seed if block == 0 else int(np.random.SeedSequence([seed, block]).generate_state(2, np.uint32)[0])


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
        states = CarryBank.sample(ranges, min(config.objects, config.rollouts), config.seed, 0.005, CPU).states
        return cls(config=config, scenes=tuple(scenes), states=states)

    def blocks(self) -> list[tuple[int, int]]:
        """(scene, block) of all trials."""
        count = -(-self.config.rollouts // self.config.batch)
        return [(scene, block) for scene in range(len(self.scenes)) for block in range(count)]

    def size(self, block: int) -> int:
        """Trials of a block."""
        return min(self.config.batch, self.config.rollouts - block * self.config.batch)

    def score(self, policy: Policy, scene: int, block: int, on_trials: Callable[[int], None] | None = None) -> Trials:
        """Runs a block on one thread."""
        with one_thread():
            return score_block(
                policy, self.scenes[scene], self.states, self.size(block), block_seed(self.config.seed, block),
                first=block * self.config.batch, fine=self.config.fine, perturbed=self.config.perturbed,
                without=self.config.without, on_trials=on_trials,
            )  # fmt: skip

    def settings(self, policy: Policy) -> dict[str, Any]:
        """What the trials depend on, JSON-ready: only trials of equal settings may be joined."""
        ignored = ("out", "threads", "policy", "scenes")
        config = {k: v for k, v in asdict(self.config).items() if k not in ignored}
        settings = {
            **config, "policy": policy_digest(policy), "source": source_version(),
            "scenes": [scene_digest(scene) for scene in self.scenes],
        }  # fmt: skip
        return json.loads(json.dumps(settings))


def scene_digest(scene: Scene) -> str:
    """SHA-256 of a scene and of the mesh files it names."""
    digest = hashlib.sha256(json.dumps(scene.to_dict(), sort_keys=True).encode())
    for obstacle in scene.obstacles:
        if isinstance(obstacle.shape, MeshShape):
            digest.update(obstacle.shape.path.read_bytes())
    return digest.hexdigest()


def policy_digest(policy: Policy) -> str:
    """SHA-256 of what a policy says of itself and of what it does at 64 random observations."""
    size = sum(width for _, width in policy.meta["layout"])
    generator = torch.Generator().manual_seed(0)
    with one_thread():
        actions = policy.act(torch.randn(64, size, generator=generator))
    said = json.dumps(policy.meta, sort_keys=True, default=str)
    return hashlib.sha256(said.encode() + actions.contiguous().numpy().tobytes()).hexdigest()


def evaluate(config: EvaluateConfig) -> dict[str, Any]:
    """Scores a policy on scenes, prints a table, writes the report; returns it. Raises `HoticeError`."""
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

    policy = load_policy(config.policy, threads=1)
    if config.out is not None:
        check_writable(config.out)
    scorer = Scorer.of(config)
    names = [scene.name for scene in scorer.scenes]
    console = Console(stderr=True)
    done: dict[tuple[int, int], Trials] = {}
    store = None
    if config.out is not None:
        store = TrialStore(Path(f"{config.out}.trials"), scorer.settings(policy), names)
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
            scorer, policy, left, config.threads, lambda n: progress.update(task, completed=before + n)
        ):
            done[scene, block] = trials
            if store is not None:
                store.add(scene, block, trials)
    blocks = [[done[key] for key in scorer.blocks() if key[0] == scene] for scene in range(len(names))]
    scores = [(name, Trials.joined(parts)) for name, parts in zip(names, blocks, strict=True)]
    report = make_report(policy, config, scores)
    if config.out is not None:
        write_text(config.out, json.dumps(report, indent=1) + "\n")
    print_report(report, Console(width=None if Console().is_terminal else 130))
    return report
