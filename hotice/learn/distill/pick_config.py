"""Distillation of planned picks into a policy, in numbers."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar

from hotice import checks
from hotice.errors import InvalidConfig
from hotice.learn.distill.config import DistillConfig
from hotice.learn.ppo.config import PpoConfig
from hotice.task.config import TaskConfig
from hotice.task.pickup import pickup_task


@dataclass(frozen=True, kw_only=True)
class PickDistillConfig(DistillConfig):
    """One distillation of a book of picks."""

    out: Path = Path("runs/pickup")
    """Folder of the run: checkpoints, TensorBoard events, configuration."""
    picks: Path | None = None
    """Book of picks, made by `hotice pickup plan`: what is picked where, and what the teacher follows."""
    teacher_updates: tuple[int, int] = (8, 40)
    """Updates until which the teacher alone acts, and from which on the student alone does; in between the share of
    robots that the student drives grows."""
    rescue_m: float = 0.05
    """Offset of the pelvis from the plan beyond which the teacher drives a robot of the student until it is back [m]:
    what is learnt from robots that are lost already is how to fall."""
    num_envs: int = 256
    """Parallel environments."""
    aggregate: int = 48
    """Rollouts that are kept and learnt from together; 1: on-policy."""
    exploration: float = 0.5
    """Share of its standard deviation with which the student acts; 0: it acts by its mean."""
    init_std: tuple[float, float] = (0.1, 0.1)
    """First standard deviation of leg and arm actions; the teacher's too."""
    curriculum: bool = False
    """Draw scenes that still fail more often than solved ones: picks have one scene."""
    ppo: PpoConfig = field(default_factory=lambda: PpoConfig(learning_rate=1e-3, epochs=8))
    """Optimiser; the learning rate stays what it is."""
    task: TaskConfig = field(default_factory=lambda: pickup_task(TaskConfig()))
    """Task."""

    CAN_TRY: ClassVar[bool] = False
    CAN_VIEW: ClassVar[bool] = False

    def __post_init__(self) -> None:
        super().__post_init__()
        first, last = self.teacher_updates
        checks.whole("teacher_updates", first, checks.NOT_NEGATIVE)
        checks.whole("teacher_updates", last, checks.NOT_NEGATIVE)
        checks.number("rescue_m", self.rescue_m, checks.POSITIVE)
        if last < first:
            raise InvalidConfig(f"teacher_updates is {first} {last}: the second must not be less than the first")

    def _check_teachers(self) -> None:
        if self.picks is None:
            raise InvalidConfig("no picks: a book of picks is needed, make one with `hotice pickup plan`")
        if self.teachers or self.generalist is not None:
            raise InvalidConfig("teachers are given: of a pick-up the book is the teacher, leave them out")

    def share(self, update: int) -> float:
        """Share of robots that the student drives after `update` updates."""
        first, last = self.teacher_updates
        return min(max((update - first) / max(last - first, 1), 0.0), 1.0)
