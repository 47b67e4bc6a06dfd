"""The commands of `hotice`, one function each."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from hotice.commands.configs import (
    BenchmarkConfig,
    DistillConfig,
    EvaluateConfig,
    ExportConfig,
    FinetuneConfig,
    Flat,
    MergeConfig,
    PipelineConfig,
    PlayConfig,
    ReproduceConfig,
    TrainConfig,
)
from hotice.commands.deploy.check_config import RobotCheckConfig
from hotice.commands.deploy.config import DeployConfig
from hotice.commands.robot_sim_config import RobotSimConfig
from hotice.commands.tags_config import TagCameraConfig, TagsConfig
from hotice.failures import STOPPED
from hotice.files import check_folder, check_writable
from hotice.owner import check_unowned
from hotice.progress import doing

if TYPE_CHECKING:
    from hotice.learn.train.runner import Runner


def train(config: Flat[TrainConfig]) -> int:
    """Train the agents of a preset with dual PPO."""
    from hotice.learn.train.runner import Runner

    return _train(Runner, config)


def distill(config: Flat[DistillConfig]) -> int:
    """Make one student of several teachers (DAgger), under noise, delays and pushes."""
    from hotice.learn.distill.dagger import DistillRunner

    return _train(DistillRunner, config)


def finetune(config: Flat[FinetuneConfig]) -> int:
    """Go on from a student with dual PPO, under noise, delays and pushes."""
    from hotice.learn.train.runner import Runner

    return _train(Runner, config)


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
    from hotice.learn.export import export_onnx
    from hotice.learn.policy import torch_policy

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


def robot_sim(config: Flat[RobotSimConfig]) -> int:
    """Simulate a robot in real time, on the messages of the real one."""
    from hotice.commands.robot_sim import robot_sim as run

    run(config)
    return 0


def tags(config: Flat[TagsConfig]) -> int:
    """Make the sheets of tags that a robot's camera knows a box by, to be printed."""
    from hotice.deploy.tags.sheet import write_sheets
    from hotice.model.objects import Box

    check_writable(config.out)
    # a sheet needs no mass
    print(write_sheets(Box(config.box, 1.0), config.out, first_id=config.first_id))
    return 0


def tag_camera(config: Flat[TagCameraConfig]) -> int:
    """Read a camera, and send where the tags of the box are in its pictures."""
    from hotice.commands.tag_camera import tag_camera as run

    run(config)
    return 0


def robot_check(config: Flat[RobotCheckConfig]) -> int:
    """Look at what a robot sends, before it moves: one table, pass or fail with the number."""
    from hotice.commands.deploy.check import robot_check as run

    run(config)
    return 0


def deploy(config: Flat[DeployConfig]) -> int:
    """Have a robot, simulated or real, carry its object to a scene's goal; `hotice deploy replay LOG`: do it again."""
    from hotice.commands.deploy.run import deploy as run

    run(config)
    return 0


def scene() -> int:
    """Import, show, check, list and generate scenes: see `hotice scene --help`."""
    raise AssertionError("hotice.commands.program hands this group to hotice.commands.scene")


def pickup() -> int:
    """Plan, learn and score pick-ups: see `hotice pickup --help`."""
    raise AssertionError("hotice.commands.program hands this group to hotice.commands.picks")


def _train(kind: Callable[[Any], Runner], config: TrainConfig) -> int:
    """Trains; first of all, whether the run can be written to its folder, and no other process does so."""
    from hotice.learn import distributed

    check_folder(config.out)
    if distributed.leads():  # the other ranks of this run would find it owned by the first
        check_unowned(config.out)
    with doing("preparing scenes, fields and objects"):
        runner = kind(config)
    return 0 if runner.train() else STOPPED


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
    "robot-sim": robot_sim,
    "tags": tags,
    "tag-camera": tag_camera,
    "robot-check": robot_check,
    "deploy": deploy,
    "scene": scene,
    "pickup": pickup,
}
