"""The commands of `hotice`, one function each."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from hotice import checks
from hotice.checks import Range
from hotice.commands.benchmark import BenchmarkConfig
from hotice.commands.pipeline.run import PipelineConfig
from hotice.commands.reproduce import ReproduceConfig
from hotice.errors import InvalidConfig
from hotice.evaluate.run import EvaluateConfig
from hotice.files import check_writable
from hotice.learn.distill.config import DistillConfig, FinetuneConfig
from hotice.learn.train.config import TrainConfig

Flat = tyro.conf.OmitArgPrefixes

STOPPED = 75
"""Exit status of a run that was asked to stop and has saved: to be gone on with (EX_TEMPFAIL of sysexits.h)."""


@dataclass(frozen=True, kw_only=True)
class ExportConfig:
    """One export."""

    policy: Path
    """Checkpoint folder, or a run (its newest checkpoint)."""
    out: Path
    """ONNX file to write."""


@dataclass(frozen=True, kw_only=True)
class MergeConfig:
    """One average of branches."""

    parts: tuple[Path, ...]
    """Checkpoint folders, or runs (their newest checkpoints), that went on from the same networks."""
    out: Path
    """Folder of the run to write: one checkpoint."""


@dataclass(frozen=True, kw_only=True)
class PlayConfig:
    """Rollouts to look at."""

    policy: str = "student"
    """Shipped policy by name, .onnx file, checkpoint folder or run; for other controllers than `policy` a name or .onnx
    file."""
    controller: Literal["policy", "walk", "pickup", "pickup_then_policy"] = "policy"
    """Who carries: the policy from a carry state; the walking baseline; the pick-up from a table alone, or followed by
    the policy, for which the walking baseline steps in where the policy's rehearsal fails, and no one where the walk's
    does too. All but `policy` need Drake."""
    scenes: Annotated[tuple[str, ...], tyro.conf.arg(aliases=["--scene"])] = ("open_floor",)
    """Scene names, files or folders."""
    seconds: float = 10.0
    """Longest run of a controller other than `policy`, after the pick-up where there is one."""
    out: Path = Path("replay.html")
    """Replay page; a picture `.png` of the same name is written beside it."""
    video: Path | None = None
    """Film (.mp4) of one rollout; needs imageio-ffmpeg."""
    video_of: int = 1
    """Which rollout is filmed, by its number in the printed list."""
    rollouts: int = 2
    """Rollouts a scene, each with another object."""
    seed: int = 0
    """Seed of objects and starts."""
    perturbed: bool = True
    """Noise, delays, pushes and uncertain dynamics as in evaluation; under other controllers than `policy` noise and
    delays."""
    protocol: Literal["robot", "paper"] | None = None
    """Physics and perturbations as in `hotice evaluate` (default: robot); of controller `policy` alone."""
    failures_first: bool = True
    """Lists failures before successes, by cause; otherwise scene by scene."""

    def __post_init__(self) -> None:
        checks.number("seconds", self.seconds, Range(above=0, most=120))
        if self.out.suffix == ".png":
            raise InvalidConfig(
                f"out is {str(self.out)!r}: the picture goes there, give the page another ending (.html)"
            )
        if self.video is not None and self.video.suffix != ".mp4":
            raise InvalidConfig(f"video is {str(self.video)!r}: a film is an .mp4 file")
        checks.whole("video_of", self.video_of, Range(least=1, note="a place in the list"))
        if self.video is None and self.video_of != 1:
            raise InvalidConfig(f"video_of is {self.video_of!r}: nothing is filmed, give the film's file as video")
        if self.protocol is not None and self.controller != "policy":
            raise InvalidConfig(
                f"protocol is {self.protocol!r} and controller {self.controller!r}, which has its own physics: leave it out"
            )
        if not self.scenes:
            raise InvalidConfig("no scenes: at least one name, file or folder is needed")
        checks.whole("rollouts", self.rollouts, Range(least=1, most=100))
        checks.whole("seed", self.seed, checks.INT64)


def train(config: Flat[TrainConfig]) -> int:
    """Train the agents of a preset with dual PPO."""
    from hotice.learn.train.runner import Runner

    return 0 if Runner(config).train() else STOPPED


def distill(config: Flat[DistillConfig]) -> int:
    """Make one student of several teachers (DAgger), under noise, delays and pushes."""
    from hotice.learn.distill.dagger import DistillRunner

    return 0 if DistillRunner(config).train() else STOPPED


def finetune(config: Flat[FinetuneConfig]) -> int:
    """Go on from a student with dual PPO, under noise, delays and pushes."""
    from hotice.learn.train.runner import Runner

    return 0 if Runner(config).train() else STOPPED


def pipeline(config: Flat[PipelineConfig]) -> int:
    """Run a graph of jobs: teachers, student, fine-tuning, evaluation, export."""
    from hotice.commands.pipeline.run import run_pipeline

    return 0 if run_pipeline(config) else STOPPED


def evaluate(config: Flat[EvaluateConfig]) -> int:
    """Score a policy, or the walking baseline, with exact collision geometry."""
    from hotice.evaluate.run import evaluate as run

    run(config)
    return 0


def reproduce(config: Flat[ReproduceConfig]) -> int:
    """Make the paper's tables, and its figure of unseen scenes, from given or newly trained policies."""
    from hotice.commands.reproduce import reproduce as run

    run(config)
    return 0


def export(config: Flat[ExportConfig]) -> int:
    """Write a policy as one ONNX file."""
    from hotice.learn.checkpoints.trained_on import in_words
    from hotice.learn.policy import export_onnx, torch_policy

    check_writable(config.out)
    policy = torch_policy(config.policy)
    print(export_onnx(policy, config.out))
    print(f"trained on {in_words(policy.meta['trained']['on'])}")
    return 0


def merge(config: Flat[MergeConfig]) -> int:
    """Average branches of one run, weight by weight, into one checkpoint."""
    from hotice.learn.checkpoints.merge import merge as run

    print(run(config.parts, config.out))
    return 0


def play(config: Flat[PlayConfig]) -> int:
    """Run a policy and write a replay page, a picture and, if asked for, a film."""
    from hotice.commands.play import play as run

    run(config)
    return 0


def tables() -> int:
    """Print rewards, observations and terminations as Markdown."""
    from hotice.commands.tables import all_tables

    print(all_tables())
    return 0


def benchmark(config: Flat[BenchmarkConfig]) -> int:
    """Measure environment steps beside bare physics."""
    from hotice.commands.benchmark import benchmark as run

    run(config)
    return 0


def scene() -> int:
    """Import, show, check, list and generate scenes: see `hotice scene --help`."""
    raise AssertionError("hotice.commands.program hands this group to hotice.commands.scene")


COMMANDS = {
    "train": train,
    "distill": distill,
    "finetune": finetune,
    "pipeline": pipeline,
    "evaluate": evaluate,
    "reproduce": reproduce,
    "merge": merge,
    "export": export,
    "play": play,
    "tables": tables,
    "benchmark": benchmark,
    "scene": scene,
}
