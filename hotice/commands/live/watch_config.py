"""Options of `hotice watch`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import tyro

from hotice import checks
from hotice.checks import Range

PORT = Range(least=0, most=65535)


@dataclass(frozen=True, kw_only=True)
class WatchConfig:
    """One look at a run that is trained, here or by another process."""

    run: tyro.conf.Positional[Path]
    """Folder of the run."""
    rollouts: int = 3
    """Scenes of the run that each new checkpoint walks, the same ones every time."""
    seed: int = 0
    """Which scenes, and of objects and starts."""
    wait: bool = False
    """Waits for a run that has not begun, instead of refusing it."""
    port: int = 0
    """Port of the page; 0 takes any free one."""

    def __post_init__(self) -> None:
        checks.whole("rollouts", self.rollouts, Range(least=1, most=20))
        checks.whole("seed", self.seed, checks.INT64)
        checks.whole("port", self.port, PORT)
