"""The paper's tables and its figure of unseen scenes, from given policies or from ones trained here on a small budget.

Everything is kept in one folder: runs, reports, similarities, `tables.md`, `tables.json`, `unseen.png`. The same
command goes on where it was interrupted.
"""

from __future__ import annotations

import dataclasses
import json
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from hotice.commands.paper_tables import TABLES, Made, origins_markdown, table_markdown, tables_json
from hotice.commands.recipes import RECIPES, ReproduceConfig
from hotice.errors import InvalidConfig, Stopped
from hotice.evaluate.config import EvaluateConfig
from hotice.evaluate.run import evaluate
from hotice.files import check_folder, make_folder, output_file, write_text
from hotice.learn.checkpoints.checkpoint import list_checkpoints, read_meta
from hotice.learn.checkpoints.trained_on import TrainedOn
from hotice.learn.checkpoints.training_scenes import whole_record
from hotice.learn.policy import load_policy
from hotice.learn.train.config import TrainConfig
from hotice.model.shipped import resolve_scenes
from hotice.version import source_version

FORMAT = "hotice-tables/1"


def reproduce(config: ReproduceConfig, training: TrainConfig | None = None) -> dict[str, Any]:
    """Makes the tables, writes and prints them; `training`: what all trainings share beside budget and recipe.

    Raises `HoticeError`, `Stopped` when a training was interrupted.
    """
    from hotice.commands.unseen_views import unseen_markdown
    from hotice.console import PlainConsole

    console = PlainConsole(stderr=True)
    check_folder(config.out)
    for name in ("tables.json", "tables.md", "unseen.png"):
        output_file(config.out / name)
    wanted = list(dict.fromkeys(row.policy for name in config.tables() for row in TABLES[name].rows))
    given, made, paths = config.given(), {}, {}
    _check_presets(given)
    _check_scenes(config, wanted)
    if "unseen" in config.tables() and "generalist" in given:
        _record(config, given["generalist"])
    make_folder(config.out)
    for name in wanted:
        command = None
        if name in given:
            path = given[name]
        elif config.resources().updates:
            console.rule(f"training {name}")
            path, command = _train(config, name, training or TrainConfig())
        else:
            continue
        console.rule(f"evaluating {name}")
        made[name], paths[name] = _evaluate(config, name, path, command), path
    result = {
        "format": FORMAT,
        "source": source_version(),
        "budget": config.budget,
        **tables_json(config.tables(), made),
    }
    parts = [table_markdown(TABLES[name], made) for name in config.tables()]
    if "unseen" in config.tables() and "generalist" in made:
        result["unseen"] |= _unseen(config, paths["generalist"], made["generalist"])
        parts.append(unseen_markdown(result["unseen"]))
    text = "\n\n".join([*parts, origins_markdown(made)]) + "\n"
    write_text(config.out / "tables.json", json.dumps(result, indent=1) + "\n")
    write_text(config.out / "tables.md", text)
    print(text)
    return result


def _train(config: ReproduceConfig, name: str, shared: TrainConfig) -> tuple[str, str]:
    """Trains a policy to the end of the budget, or goes on; returns its run and the command that does the same."""
    from hotice.learn.train.runner import Runner

    recipe, budget = RECIPES[name], config.resources()
    objects = replace(shared.task.objects, shapes=(recipe.shape,))
    train = replace(
        shared,
        out=config.out / "runs" / name,
        preset=recipe.preset,
        scenes=config.scenes(recipe.train_scenes),
        num_envs=budget.num_envs,
        updates=budget.updates,
        seed=config.seed,
        threads=config.threads,
        resume=True,
        task=replace(shared.task, objects=objects),
    )
    if not _trained(train):
        Runner(train).train()
    if not _trained(train):
        raise Stopped(f"training of {name} was interrupted and is saved: the same command goes on")
    return str(train.out), train_command(train)


def _trained(train: TrainConfig) -> bool:
    newest = [int(read_meta(p).get("update", 0)) for p in list_checkpoints(train.out)[-1:]]
    return bool(newest) and newest[0] >= train.updates


def train_command(config: TrainConfig) -> str:
    """The `hotice train` that does the same: every option that differs from its default."""
    return shlex.join(["hotice", "train", *_options(config, TrainConfig())])


def _options(config: Any, default: Any) -> Sequence[str]:
    options: list[str] = []
    for field in dataclasses.fields(config):
        value, usual = getattr(config, field.name), getattr(default, field.name)
        flag = "--" + field.name.replace("_", "-")
        if dataclasses.is_dataclass(value):
            options += _options(value, usual)
        elif value != usual and isinstance(value, bool):
            options.append(flag if value else f"--no-{flag[2:]}")
        elif value != usual:
            options += [flag, *map(str, value if isinstance(value, tuple) else (value,))]
    return options


def _evaluate(config: ReproduceConfig, name: str, path: str, trained_by: str | None) -> Made:
    recipe = RECIPES[name]
    asked = EvaluateConfig(
        policy=path,
        scenes=config.scenes(recipe.test_scenes),
        rollouts=config.resources().rollouts,
        seed=config.seed,
        out=config.out / f"{name}.json",
        threads=config.threads,
        protocol=config.protocol,
        perturbed=config.perturbed,
        shapes=(recipe.shape,),
    )
    required = ["--policy", path, "--scenes", *asked.scenes]
    options = _options(asked, EvaluateConfig(policy=path, scenes=asked.scenes))
    command = shlex.join(["hotice", "evaluate", *required, *options])
    return Made(report=evaluate(asked), evaluated_by=command, trained_by=trained_by)


def _check_presets(given: Mapping[str, str]) -> None:
    for name, path in given.items():
        preset, needed = load_policy(path, threads=1).meta["preset"], RECIPES[name].preset
        if preset != needed:
            raise InvalidConfig(f"{name}={path}: was trained as {preset!r}, the tables need {needed!r}")


def _check_scenes(config: ReproduceConfig, names: Sequence[str]) -> None:
    """Raises `HoticeError` before anything is trained for scenes that are needed in the end and cannot be had."""
    for kind in dict.fromkeys(k for name in names for k in (RECIPES[name].train_scenes, RECIPES[name].test_scenes)):
        resolve_scenes(config.scenes(kind))


def _record(config: ReproduceConfig, path: str) -> TrainedOn:
    """Training record of the generalist. Raises `CheckpointError` or `InvalidConfig`, see `whole_record`."""
    return whole_record(load_policy(path, threads=1).meta, path, config.trained_on)


def _unseen(config: ReproduceConfig, path: str, made: Made) -> dict[str, Any]:
    """Similarities, points, groups and fits; draws the figure."""
    from hotice.commands.unseen import compared, unseen_points
    from hotice.commands.unseen_views import draw_unseen

    nearest = compared(resolve_scenes(config.unseen), _record(config, path))
    result = unseen_points(nearest, made.report)
    draw_unseen(result, config.out / "unseen.png")
    return result
