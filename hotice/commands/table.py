"""The commands of `hotice`, one function each."""

from __future__ import annotations

import contextlib
import shlex
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

from hotice.failures import STOPPED
from hotice.files import check_folder, check_writable
from hotice.owner import check_unowned
from hotice.progress import doing

if TYPE_CHECKING:
    from hotice.commands.configs import ExportConfig, MergeConfig, PipelineConfig, PlayConfig
    from hotice.commands.deploy.check_config import RobotCheckConfig
    from hotice.commands.deploy.config import DeployConfig
    from hotice.commands.line.benchmark_config import BenchmarkConfig
    from hotice.commands.live.watch_config import WatchConfig
    from hotice.commands.recipes import ReproduceConfig
    from hotice.commands.robot_sim_config import RobotSimConfig
    from hotice.commands.tags_config import TagCameraConfig, TagsConfig
    from hotice.evaluate.config import EvaluateConfig
    from hotice.learn.distill.config import DistillConfig, FinetuneConfig
    from hotice.learn.train.config import TrainConfig
    from hotice.learn.train.runner import Runner


def train(config: TrainConfig) -> int:
    """Train the agents of a preset with dual PPO."""
    _check_names(config.scenes)
    from hotice.learn.train.runner import Runner

    return _train(Runner, config)


def distill(config: DistillConfig) -> int:
    """Make one student of several teachers (DAgger), under noise, delays and pushes."""
    _check_names(config.scenes)
    from hotice.learn.distill.dagger import DistillRunner

    return _train(DistillRunner, config)


def finetune(config: FinetuneConfig) -> int:
    """Go on from a student with dual PPO, under noise, delays and pushes."""
    _check_names(config.scenes)
    from hotice.learn.train.runner import Runner

    return _train(Runner, config)


def pipeline(config: PipelineConfig) -> int:
    """Run a graph of jobs: teachers, student, fine-tuning, evaluation, export."""
    from hotice.commands.pipeline.run import run_pipeline

    return 0 if run_pipeline(config) else STOPPED


def evaluate(config: EvaluateConfig) -> int:
    """Score a policy, or the walking baseline, with exact collision geometry."""
    _check_names(config.scenes, config.policy)
    if config.task == "job":
        from hotice.commands.jobs.evaluate import evaluate_jobs

        evaluate_jobs(config)
        return 0
    from hotice.commands.warm import warm_once
    from hotice.evaluate.run import evaluate as run

    warm_once()
    run(config)
    return 0


def reproduce(config: ReproduceConfig) -> int:
    """Make the paper's tables, and its figure of unseen scenes, from given or newly trained policies."""
    from hotice.commands.reproduce import reproduce as run

    run(config)
    return 0


def export(config: ExportConfig) -> int:
    """Write a policy as one ONNX file."""
    from hotice.learn.checkpoints.trained_on import in_words
    from hotice.learn.export import export_onnx
    from hotice.learn.policy import torch_policy

    check_writable(config.out)
    policy = torch_policy(config.policy)
    print(export_onnx(policy, config.out))
    print(f"trained on {in_words(policy.meta['trained']['on'])}")
    print(f"next: hotice evaluate --policy {shlex.quote(str(config.out))} --scenes bench20 --rollouts 4")
    return 0


def merge(config: MergeConfig) -> int:
    """Average branches of one run, weight by weight, into one checkpoint."""
    from hotice.learn.checkpoints.merge import merge as run

    print(run(config.parts, config.out))
    return 0


def play(config: PlayConfig) -> int:
    """Run a policy and write a replay page, a picture and, if asked for, a film."""
    _check_names(config.scenes, config.policy if config.controller in ("policy", "pickup_then_policy", "job") else None)
    if config.view:
        from hotice.commands.live.play_view import play_view

        play_view(config)
        return 0
    from hotice.commands.play import play as run

    run(config)
    return 0


def watch(config: WatchConfig) -> int:
    """Show a run that is trained in the browser: its curves, and walks of each new checkpoint."""
    from hotice.commands.live.watch import watch as run
    from hotice.console import PlainConsole

    said = PlainConsole()
    run(config, lambda url: said.print(f"live page of {config.run}: {url} (Ctrl-C ends)", soft_wrap=True))
    return 0


def warm() -> int:
    """Compile what is compiled once (about a minute), so that later commands begin at once."""
    from hotice.commands.warm import warm as run

    run()
    return 0


def tables() -> int:
    """Print rewards, observations and terminations as Markdown."""
    from hotice.commands.tables import all_tables

    print(all_tables())
    return 0


def benchmark(config: BenchmarkConfig) -> int:
    """Measure environment steps beside bare physics."""
    _check_names(config.scenes)
    from hotice.commands.benchmark import benchmark as run

    run(config)
    return 0


def robot_sim(config: RobotSimConfig) -> int:
    """Simulate a robot in real time, on the messages of the real one."""
    from hotice.commands.robot_sim import robot_sim as run

    run(config)
    return 0


def tags(config: TagsConfig) -> int:
    """Make the sheets of tags that a robot's camera knows a box by, to be printed."""
    from hotice.deploy.tags.sheet import write_sheets
    from hotice.model.objects import Box

    check_writable(config.out)
    # a sheet needs no mass
    print(write_sheets(Box(config.box, 1.0), config.out, first_id=config.first_id))
    return 0


def tag_camera(config: TagCameraConfig) -> int:
    """Read a camera, and send where the tags of the box are in its pictures."""
    from hotice.commands.tag_camera import tag_camera as run

    run(config)
    return 0


def robot_check(config: RobotCheckConfig) -> int:
    """Look at what a robot sends, before it moves: one table, pass or fail with the number."""
    from hotice.commands.deploy.check import robot_check as run

    run(config)
    return 0


def deploy(config: DeployConfig) -> int:
    """Have a robot, simulated or real, carry its object to a scene's goal; `deploy replay LOG`: do it again."""
    from hotice.commands.deploy.run import deploy as run

    run(config)
    return 0


def scene() -> int:
    """Import, show, check, list and generate scenes: see `hotice scene --help`."""
    raise AssertionError("hotice.commands.program hands this group to hotice.commands.scene")


def pickup() -> int:
    """Plan, learn and score pick-ups: see `hotice pickup --help`."""
    raise AssertionError("hotice.commands.program hands this group to hotice.commands.picks")


def _check_names(scenes: Sequence[str], policy: str | None = None) -> None:
    """Raises `UnknownName` at once, before what takes seconds to import; whoever reads the files checks them anew."""
    from hotice.model.shipped import check_names

    check_names(scenes)
    if policy is not None:
        from hotice.policy.policy_file import check_name

        check_name(policy)


def _train(kind: Callable[[Any], Runner], config: TrainConfig) -> int:
    """Trains; first of all, whether the run can be written to its folder, and no other process does so."""
    from hotice.learn import distributed
    from hotice.learn.branches.run import runner_of

    check_folder(config.out)
    if distributed.leads():  # the other ranks of this run would find it owned by the first
        check_unowned(config.out)
    with _watched(config):
        with doing("preparing scenes, fields and objects"):
            runner = runner_of(kind, config)
        done = runner.train()
    if distributed.leads():
        _say_next(config)
    return 0 if done else STOPPED


@contextlib.contextmanager
def _watched(config: TrainConfig) -> Iterator[None]:
    """Shows the run within the context, where that is asked for, by another process; tells the page's address."""
    from hotice.learn import distributed

    if not (config.view and distributed.leads()):
        yield
        return
    from hotice.commands.live.watch_child import watching
    from hotice.console import PlainConsole

    with watching(config.out, config.view_port) as url:
        PlainConsole(stderr=True).print(f"live page: {url}", soft_wrap=True)
        yield


def _say_next(config: TrainConfig) -> None:
    """Prints what one would type after a training."""
    run, scenes = shlex.quote(str(config.out)), " ".join(map(shlex.quote, config.scenes))
    how = "" if config.perturbed else " --no-perturbed"
    print("next:")
    print(f"  hotice evaluate --policy {run} --scenes {scenes} --rollouts 20{how}")
    print(f"  hotice play --policy {run} --scenes {shlex.quote(config.scenes[0])}{how}")
    print(f"  hotice export --policy {run} --out {run}.onnx")
    print("  the same command with --resume goes on")


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
    "watch": watch,
    "warm": warm,
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
