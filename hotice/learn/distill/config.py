"""Distillation and fine-tuning in numbers: training under what a robot would meet."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import ClassVar

from hotice import checks
from hotice.checks import Range
from hotice.errors import InvalidConfig
from hotice.learn.branches.config import BranchConfig  # noqa: F401 - the reference looks inherited types up here
from hotice.learn.ppo.config import PpoConfig
from hotice.learn.train.config import TrainConfig
from hotice.task.config import TaskConfig

TEACHERS = ("specialist", "generalist")
"""Names of teachers, before their paths."""
PPO_ALONE = ("clip", "target_kl", "max_learning_rate", "entropy")
"""Options of the optimiser that distillation, whose learning rate and losses are others, does not read."""


def student_task() -> TaskConfig:
    """The task of training with a population of robots: each carry state has its own dynamics."""
    return replace(TrainConfig().task, carry_states=256)


@dataclass(frozen=True, kw_only=True)
class DistillConfig(TrainConfig):
    """One distillation."""

    out: Path = Path("runs/student")
    """Folder of the run: checkpoints, TensorBoard events, configuration."""
    teachers: tuple[Path, ...] = ()
    """Specialists: checkpoints or runs, also as specialist=PATH. Each teaches in the scenes that it was trained on.
    generalist=PATH: the same as --generalist."""
    generalist: Path | None = None
    """Teacher of the scenes that no specialist knows."""
    aggregate: int = 1
    """Rollouts that are kept and learnt from together; 1: on-policy."""
    exploration: float = 1.0
    """Share of its standard deviation with which the student acts; 0: it acts by its mean."""
    ppo: PpoConfig = field(default_factory=lambda: PpoConfig(learning_rate=5e-4))
    """Optimiser; the learning rate stays what it is."""
    perturbed: bool = True
    """Noise, delays, pushes and uncertain dynamics as for students."""
    task: TaskConfig = field(default_factory=student_task)
    """Task."""

    CAN_BRANCH: ClassVar[bool] = False

    def __post_init__(self) -> None:
        super().__post_init__()
        self._read_names()
        self._check_teachers()
        checks.whole("aggregate", self.aggregate, Range(least=1, most=64, unit="rollouts"))
        checks.number("exploration", self.exploration, checks.SHARE)
        usual = PpoConfig()
        for name in PPO_ALONE:
            if getattr(self.ppo, name) != getattr(usual, name):
                raise InvalidConfig(
                    f"{name} is {getattr(self.ppo, name)}: distillation does not use it, leave it out "
                    f"({', '.join(PPO_ALONE)} are of dual PPO)"
                )

    def _check_teachers(self) -> None:
        if not self.teachers and self.generalist is None:
            raise InvalidConfig("no teachers: runs of specialists (teachers), of a generalist, or both are needed")

    def _read_names(self) -> None:
        """Takes apart NAME=PATH among the teachers, the form in which `hotice reproduce` is given policies."""
        specialists, generalists = [], [self.generalist] if self.generalist is not None else []
        for teacher in self.teachers:
            name, equals, path = str(teacher).partition("=")
            if equals and name in TEACHERS and not path:
                raise InvalidConfig(f"teacher {str(teacher)!r}: {name}=PATH is needed")
            if equals and name == "generalist":
                generalists.append(Path(path))
            else:
                specialists.append(Path(path) if equals and name in TEACHERS else teacher)
        if len(generalists) > 1:
            raise InvalidConfig(f"{len(generalists)} generalists are given: one is enough")
        object.__setattr__(self, "teachers", tuple(specialists))
        object.__setattr__(self, "generalist", generalists[0] if generalists else None)

    def begins_from(self) -> tuple[Path, ...]:
        generalist = () if self.generalist is None else (self.generalist,)
        return (*super().begins_from(), *self.teachers, *generalist)


@dataclass(frozen=True, kw_only=True)
class FinetuneConfig(TrainConfig):
    """Dual PPO that goes on from a student, in the student's task, with care."""

    out: Path = Path("runs/finetuned")
    """Folder of the run: checkpoints, TensorBoard events, configuration."""
    critic_updates: int = 50
    """First updates that train only the critics: they get to know the task before they lead the actors."""
    ppo: PpoConfig = field(
        default_factory=lambda: PpoConfig(learning_rate=2e-4, max_learning_rate=1e-3, target_kl=0.01)
    )
    """Optimiser: smaller steps than from nothing (ours)."""
    perturbed: bool = True
    """Noise, delays, pushes and uncertain dynamics as for students."""
    task: TaskConfig = field(default_factory=student_task)
    """Task."""

    NEEDS_INIT: ClassVar[bool] = True

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.init is None and not self.resume:
            raise InvalidConfig("no init: the checkpoint or run of a student is needed")
