"""The commands of `hotice`, one function each."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import tyro

from hotice.errors import InvalidConfig
from hotice.learn.benchmark import BenchmarkConfig
from hotice.learn.config import TrainConfig
from hotice.learn.evaluate import EvaluateConfig
from hotice.learn.student_config import DistillConfig, FinetuneConfig

Flat = tyro.conf.OmitArgPrefixes


@dataclass(frozen=True, kw_only=True)
class ExportConfig:
    """One export."""

    policy: Path
    """Checkpoint folder, or a run (its newest checkpoint)."""
    out: Path
    """ONNX file to write."""


@dataclass(frozen=True, kw_only=True)
class PlayConfig:
    """Rollouts to look at."""

    policy: str
    """Shipped policy by name, .onnx file, checkpoint folder or run."""
    scenes: tuple[str, ...] = ("open_floor",)
    """Scene names, files or folders."""
    out: Path = Path("replay.html")
    """Replay page; a picture `.png` of the same name is written beside it."""
    rollouts: int = 2
    """Rollouts a scene, each with another object."""
    seed: int = 0
    """Seed of objects and starts."""

    def __post_init__(self) -> None:
        if not 1 <= self.rollouts <= 100:
            raise InvalidConfig(f"rollouts is {self.rollouts!r}: 1 to 100 are allowed")
        if not 0 <= self.seed < 2**63:
            raise InvalidConfig(f"seed is {self.seed!r}: 0 or more is needed")


def train(config: Flat[TrainConfig]) -> int:
    """Train the agents of a preset with dual PPO."""
    from hotice.learn.runner import Runner

    Runner(config).train()
    return 0


def distill(config: Flat[DistillConfig]) -> int:
    """Make one student of several teachers (DAgger), under noise, delays and pushes."""
    from hotice.learn.dagger import DistillRunner

    DistillRunner(config).train()
    return 0


def finetune(config: Flat[FinetuneConfig]) -> int:
    """Go on from a student with dual PPO, under noise, delays and pushes."""
    from hotice.learn.runner import Runner

    Runner(config).train()
    return 0


def evaluate(config: Flat[EvaluateConfig]) -> int:
    """Score a policy with exact collision geometry."""
    from hotice.learn.evaluate import evaluate as run

    run(config)
    return 0


def export(config: Flat[ExportConfig]) -> int:
    """Write a policy as one ONNX file."""
    from hotice.learn.evaluate import check_writable
    from hotice.learn.policy import export_onnx, torch_policy

    check_writable(config.out)
    print(export_onnx(torch_policy(config.policy), config.out))
    return 0


def play(config: Flat[PlayConfig]) -> int:
    """Run a policy and write a replay page and a picture."""
    import torch

    from hotice.learn.evaluate import check_writable
    from hotice.learn.policy import load_policy
    from hotice.learn.record import record_rollouts
    from hotice.learn.scene_sets import resolve_scenes
    from hotice.model.object_range import ObjectRange
    from hotice.replay import write_html, write_overview
    from hotice.sim.carry_bank import CarryBank

    check_writable(config.out)
    policy = load_policy(config.policy)
    scenes = resolve_scenes(config.scenes)
    states = CarryBank.sample(ObjectRange(), config.rollouts, config.seed, 0.005, torch.device("cpu")).states
    records = [r for scene in scenes for r in record_rollouts(policy, scene, states, seed=config.seed)]
    for record in records:
        print(f"{record.scene.name}: {record.outcome} after {record.time_s[-1]:.1f} s")
    print(write_html(records, config.out))
    print(write_overview(records, config.out.with_suffix(".png")))
    return 0


def tables() -> int:
    """Print rewards, observations and terminations as Markdown."""
    from hotice.learn.tables import all_tables

    print(all_tables())
    return 0


def benchmark(config: Flat[BenchmarkConfig]) -> int:
    """Measure environment steps beside bare physics."""
    from hotice.learn.benchmark import benchmark as run

    run(config)
    return 0


def scene() -> int:
    """Import, show, check, list and generate scenes: see `hotice scene --help`."""
    raise AssertionError("hotice.learn.__main__ hands this group to hotice.scene_commands")


COMMANDS = {
    "train": train, "distill": distill, "finetune": finetune, "evaluate": evaluate, "export": export, "play": play,
    "tables": tables, "benchmark": benchmark, "scene": scene,
}  # fmt: skip
