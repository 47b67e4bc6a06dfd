"""Dual PPO on the pick-up, in numbers."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar

from hotice.errors import InvalidConfig
from hotice.learn.ppo.config import PpoConfig
from hotice.learn.train.config import TrainConfig
from hotice.task.config import TaskConfig
from hotice.task.pickup import pickup_task


@dataclass(frozen=True, kw_only=True)
class PickTrainConfig(TrainConfig):
    """Dual PPO on the pick-up, from a student of planned picks: from nothing it finds no grasp."""

    out: Path = Path("runs/pickup-ppo")
    """Folder of the run: checkpoints, TensorBoard events, configuration."""
    picks: Path | None = None
    """Book of picks, made by `hotice pickup plan`."""
    num_envs: int = 256
    """Parallel environments."""
    critic_updates: int = 20
    """First updates that train only the critics: they get to know the task before they lead the actors."""
    init_std: tuple[float, float] = (0.1, 0.1)
    """First standard deviation of leg and arm actions."""
    curriculum: bool = False
    """Draw scenes that still fail more often than solved ones: picks have one scene."""
    perturbed: bool = True
    """Noise, delays and uncertain dynamics as for students; nobody pushes."""
    ppo: PpoConfig = field(
        default_factory=lambda: PpoConfig(learning_rate=2e-4, max_learning_rate=1e-3, target_kl=0.01)
    )
    """Optimiser: smaller steps than from nothing (ours)."""
    task: TaskConfig = field(default_factory=lambda: pickup_task(TaskConfig()))
    """Task."""

    CAN_TRY: ClassVar[bool] = False
    CAN_VIEW: ClassVar[bool] = False

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.picks is None:
            raise InvalidConfig("no picks: a book of picks is needed, make one with `hotice pickup plan`")
        if self.init is None and not self.resume:
            raise InvalidConfig("no init: the checkpoint or run of a student is needed, see `hotice pickup distill`")
