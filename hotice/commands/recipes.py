"""Recipes of the paper's tables, and the options of making them: budgets, `hotice reproduce`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Literal

import tyro

from hotice import checks
from hotice.commands.paper_tables import TABLES
from hotice.errors import InvalidConfig, UnknownName
from hotice.task.presets import PRESETS


@dataclass(frozen=True, kw_only=True)
class Recipe:
    """Scenes and budget that a policy of the tables is trained and evaluated on."""

    preset: str = "dual_hodpf"
    shape: str = "box"
    train_scenes: str = "bench20"
    test_scenes: str = "bench20"


RECIPES: Mapping[str, Recipe] = {
    **{name: Recipe(preset=name) for name in PRESETS},
    "cylinder": Recipe(shape="cylinder"),
    "sphere": Recipe(shape="sphere"),
    "generalist": Recipe(train_scenes="train75", test_scenes="unseen50"),
}


@dataclass(frozen=True, kw_only=True)
class Budget:
    """Trials a scene, and the length of training; without updates nothing is trained."""

    rollouts: int
    updates: int
    num_envs: int = 1024


BUDGETS: Mapping[str, Budget] = {"small": Budget(rollouts=100, updates=120), "paper": Budget(rollouts=1000, updates=0)}
"""Small: 2.9 M steps a policy, the same for each. Paper: 1,000 trials a scene of policies that are given."""


@dataclass(frozen=True, kw_only=True)
class ReproduceConfig:
    """One reproduction."""

    what: Annotated[Literal["table1", "table2", "unseen", "all"], tyro.conf.Positional]
    """Result of the paper to make."""
    budget: Literal["small", "paper"] = "small"
    """small: policies that are not given are trained for the same small number of steps, 100 trials a scene; paper:
    1,000 trials a scene, nothing is trained."""
    out: Path = Path("reproduce")
    """Folder of everything that is made."""
    policies: tuple[str, ...] = ()
    """Given policies as NAME=PATH; NAME: a preset, cylinder, sphere or generalist; PATH: as for `hotice evaluate`."""
    rollouts: int = 0
    """Trials a scene; 0: the budget's."""
    updates: int = 0
    """Updates of each training; 0: the budget's."""
    num_envs: int = 0
    """Environments of each training; 0: the budget's."""
    seed: int = 0
    """Seed of training and evaluation."""
    threads: int = 0
    """Cores; 0: all that this process may use."""
    protocol: Literal["robot", "paper"] = "robot"
    """Physics and perturbations of the evaluations, as in `hotice evaluate`; tables name it."""
    perturbed: bool = True
    """Noise, delays, pushes and uncertain dynamics in evaluation, as in the paper."""
    bench: tuple[str, ...] = ("bench20",)
    """Scenes of the tables, in training and evaluation."""
    training: tuple[str, ...] = ("train75",)
    """Training scenes of the generalist, where it is trained here."""
    trained_on: tuple[str, ...] = ()
    """All scenes that a given generalist and its ancestors were trained on, to which unseen ones are compared: only for
    a policy that carries no whole record of them."""
    unseen: tuple[str, ...] = ("unseen50",)
    """Unseen scenes."""

    def __post_init__(self) -> None:
        checks.wholes(self, checks.INT64, "rollouts", "updates", "num_envs", "seed", "threads")
        self.given()

    def given(self) -> dict[str, str]:
        """Given policies by name. Raises `InvalidConfig` or `UnknownName`."""
        pairs = [text.partition("=") for text in self.policies]
        for name, equals, path in pairs:
            if not equals or not path:
                raise InvalidConfig(f"policy {name + equals!r}: NAME=PATH is needed")
            if name not in RECIPES:
                raise UnknownName("policy of the tables", name, RECIPES)
        return {name: path for name, _, path in pairs}

    def tables(self) -> list[str]:
        """Names of the tables that are asked for."""
        return list(TABLES) if self.what == "all" else [self.what]

    def scenes(self, name: str) -> tuple[str, ...]:
        """Scenes of a set of a recipe."""
        return {"bench20": self.bench, "train75": self.training, "unseen50": self.unseen}[name]

    def resources(self) -> Budget:
        """The budget, with what was asked for instead."""
        own = {k: getattr(self, k) for k in ("rollouts", "updates", "num_envs") if getattr(self, k)}
        return replace(BUDGETS[self.budget], **own)
