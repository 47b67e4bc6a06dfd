"""Scoring a policy: success rate and mean distance, with exact collision geometry (paper, V-A).

A trial ends at success, at a failure, or after 5 s. Success: the root comes within 0.1 m (horizontally) of the goal before
any fall, drop or collision of robot or object. Mean distance: root to goal at the end of each trial, averaged.
Every link of the robot and the object are tested against every obstacle geometry in the simulator, in every physics step.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import torch

from hotice.errors import InvalidConfig, OutputError
from hotice.fields.bank import FieldBank
from hotice.files import write_text
from hotice.learn.policy import Policy, check_layout, load_policy
from hotice.learn.version import source_version
from hotice.learn.wilson import wilson
from hotice.model.object_range import ObjectRange
from hotice.model.scene import Scene
from hotice.sim.carry_bank import CarryBank
from hotice.sim.config import TaskConfig
from hotice.sim.env import TransportEnv
from hotice.sim.memory import check_memory
from hotice.sim.terminations import OUTCOMES
from hotice.sim.threads import use_threads

FORMAT = "hotice-report/1"
CAUSES = ("robot_collision", "object_collision", "fall", "drop", "timeout", "unstable")
PLURAL = {
    "robot_collision": "robot_collisions", "object_collision": "object_collisions", "fall": "falls", "drop": "drops",
    "timeout": "timeouts", "unstable": "unstable",
}  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class EvaluateConfig:
    """One evaluation."""

    policy: str
    """Shipped policy by name, .onnx file, checkpoint folder or run."""
    scenes: tuple[str, ...]
    """Scene names, files, folders, or families as `family:NAME:COUNT`."""
    rollouts: int = 100
    """Trials a scene."""
    seed: int = 0
    """Seed of objects and starts."""
    out: Path | None = None
    """Report file (JSON); none: only print."""
    batch: int = 256
    """Trials simulated at once."""
    threads: int = 0
    """Threads; 0: all cores."""
    fine: bool = False
    """Simulate with 2 ms steps and elliptic friction cones instead of the training settings."""
    perturbed: bool = False
    """Noise, delays, pushes and uncertain dynamics as in the training of students."""
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
                raise InvalidConfig(f"{name} is {getattr(self, name)!r}: 0 or more is needed")
        if not self.scenes:
            raise InvalidConfig("no scenes: at least one name, file or folder is needed")


@dataclass
class SceneScore:
    """Trials of one scene."""

    name: str
    outcomes: dict[str, int] = field(default_factory=dict)
    distances_m: list[float] = field(default_factory=list)
    times_s: list[float] = field(default_factory=list)

    @property
    def rollouts(self) -> int:
        return len(self.distances_m)

    @property
    def successes(self) -> int:
        return self.outcomes.get("success", 0)

    @property
    def mean_distance_m(self) -> float:
        return sum(self.distances_m) / max(1, self.rollouts)

    def to_dict(self) -> dict[str, Any]:
        low, high = wilson(self.successes, self.rollouts)
        times = [t for t in self.times_s if t > 0]
        return {
            "name": self.name, "rollouts": self.rollouts, "success_rate": self.successes / max(1, self.rollouts),
            "success_interval_95": [round(low, 4), round(high, 4)], "mean_distance_m": self.mean_distance_m,
            "mean_success_time_s": sum(times) / len(times) if times else None,
            **{PLURAL[c]: self.outcomes.get(c, 0) for c in CAUSES},
        }  # fmt: skip


def evaluation_task(task: dict[str, Any], *, fine: bool = False, perturbed: bool = False) -> TaskConfig:
    """The task a policy was trained on, with the paper's trial: 5 s, from the scene's start, over at the goal."""
    known = TaskConfig()
    kept = (
        "leg_scale_rad", "arm_scale_rad", "action_limit", "speed_m_s", "stop_gain_hz", "gait_hz", "swing_height_m",
        "resolution_m", "margin_m",
    )  # fmt: skip
    values = {k: task[k] for k in kept if k in task}
    if fine:
        values |= {"physics_dt_s": 0.002, "substeps": 10}
    known = known.perturbed() if perturbed else known
    return replace(
        known, **values, episode_s=5.0, goal_radius_m=0.1, anywhere=0.0, end_at_goal=True, collisions=True,
        start_noise_m=0.03, start_yaw_noise_rad=0.1,
    )  # fmt: skip


def score_scene(
    policy: Policy, scene: Scene, states: Sequence, rollouts: int, seed: int, *, batch: int = 256, threads: int = 0,
    fine: bool = False, perturbed: bool = False, on_trials: Callable[[int], None] | None = None,
) -> SceneScore:  # fmt: skip
    """Runs the trials of one scene; every carry state is used in turn."""
    config = evaluation_task(policy.meta["task"], fine=fine, perturbed=perturbed)
    device = torch.device("cpu")
    bank = FieldBank.build([scene], config.resolution_m, config.margin_m)
    carry = CarryBank.of(
        states, config.physics_dt_s, device, scene=scene, elliptic=fine, dynamics=config.dynamics, seed=seed
    )
    score = SceneScore(scene.name)
    size = min(batch, rollouts)
    env = TransportEnv(size, bank, carry, policy.meta["preset"], seed=seed, config=config, threads=threads)
    check_layout(policy, env.policy_table.layout())
    while score.rollouts < rollouts:
        count = min(size, rollouts - score.rollouts)
        env.memory.model[:] = (torch.arange(size) + score.rollouts) % len(states)
        obs, _ = env.reset()
        open_trials = torch.arange(size) < count
        while open_trials.any():
            step = env.step(policy.act(obs))
            obs = step.policy
            for i in torch.nonzero((step.outcome > 0) & open_trials).squeeze(1).tolist():
                name = OUTCOMES[int(step.outcome[i])]
                score.outcomes[name] = score.outcomes.get(name, 0) + 1
                score.distances_m.append(float(step.goal_distance[i]))
                score.times_s.append(float(step.length[i]) * config.control_dt_s if name == "success" else 0.0)
                open_trials[i] = False
                if on_trials:
                    on_trials(1)
    return score


def evaluate(config: EvaluateConfig) -> dict[str, Any]:
    """Scores a policy on scenes, prints a table, writes the report; returns it. Raises `HoticeError`."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    from hotice.learn.scene_sets import resolve_scenes

    use_threads(config.threads)
    policy = load_policy(config.policy)
    scenes = resolve_scenes(config.scenes)
    check_memory(min(config.batch, config.rollouts), config.rollouts * len(scenes))
    if config.out is not None:
        check_writable(config.out)
    ranges = ObjectRange(shapes=config.shapes, size_m=config.size_m, mass_kg=config.mass_kg)
    states = CarryBank.sample(
        ranges, min(config.objects, config.rollouts), config.seed, 0.005, torch.device("cpu")
    ).states
    console = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    scores = []
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task("trials", total=config.rollouts * len(scenes))
        for scene in scenes:
            progress.update(task, description=scene.name)
            scores.append(
                score_scene(
                    policy, scene, states, config.rollouts, config.seed, batch=config.batch, threads=config.threads,
                    fine=config.fine, perturbed=config.perturbed, on_trials=lambda n: progress.advance(task, n),
                )
            )  # fmt: skip
    report = make_report(policy, config, scores)
    if config.out is not None:
        write_text(config.out, json.dumps(report, indent=1) + "\n")
    print_report(report, Console(width=None if Console().is_terminal else 130))
    return report


def make_report(policy: Policy, config: EvaluateConfig, scores: Sequence[SceneScore]) -> dict[str, Any]:
    """The report as JSON-ready values, format hotice-report/1."""
    total = sum(s.rollouts for s in scores)
    wins = sum(s.successes for s in scores)
    low, high = wilson(wins, total)
    return {
        "format": FORMAT, "policy": policy.name, "seed": config.seed, "rollouts": config.rollouts,
        "success_rate": wins / max(1, total), "success_interval_95": [round(low, 4), round(high, 4)],
        "mean_distance_m": sum(sum(s.distances_m) for s in scores) / max(1, total),
        "perturbed": config.perturbed, "physics": "2 ms, elliptic" if config.fine else "5 ms, pyramidal",
        "objects": {"shapes": list(config.shapes), "size_m": list(config.size_m), "mass_kg": list(config.mass_kg)},
        "trained": policy.meta.get("trained", {}), "preset": policy.meta["preset"], "source": source_version(),
        "scenes": [s.to_dict() for s in scores],
    }  # fmt: skip


def print_report(report: dict[str, Any], console) -> None:
    """Prints the report as a table."""
    from rich.table import Table

    table = Table(
        title=f"{report['policy']}: {report['rollouts']} trials a scene, seed {report['seed']}, {report['physics']}"
        + (", noise and pushes" if report["perturbed"] else "")
    )
    for name, justify in (
        ("scene", "left"),
        ("success", "right"),
        ("95 %", "right"),
        ("distance [m]", "right"),
        ("time [s]", "right"),
    ):
        table.add_column(name, justify=justify)  # type: ignore[arg-type]
    for cause in ("robot hit", "object hit", "fall", "drop", "timeout"):
        table.add_column(cause, justify="right")
    for row in report["scenes"]:
        low, high = row["success_interval_95"]
        time = row["mean_success_time_s"]
        table.add_row(
            row["name"], f"{row['success_rate']:.1%}", f"{100 * low:.0f}–{100 * high:.0f}", f"{row['mean_distance_m']:.3f}",
            "–" if time is None else f"{time:.2f}", *(str(row[PLURAL[c]]) for c in CAUSES[:5]),
        )  # fmt: skip
    low, high = report["success_interval_95"]
    table.add_section()
    table.add_row(
        "all", f"{report['success_rate']:.1%}", f"{100 * low:.0f}–{100 * high:.0f}", f"{report['mean_distance_m']:.3f}"
    )
    console.print(table)


def check_writable(path: Path) -> None:
    """Raises `OutputError` now rather than after the work, when the report could not be written."""
    import os

    folder = path.parent
    if path.is_dir():
        raise OutputError(f"cannot write {path}: it is a folder")
    if not folder.is_dir():
        raise OutputError(f"cannot write {path}: folder {folder} does not exist")
    if not os.access(folder, os.W_OK):
        raise OutputError(f"cannot write {path}: folder {folder} is not writable")
