"""What a run and the processes of its branches tell each other, over a pipe of `multiprocessing`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hotice.learn.train.trials import TrialResults


@dataclass(frozen=True, kw_only=True)
class Begin:
    """Order to write the checkpoint that all branches begin from."""


@dataclass(frozen=True, kw_only=True)
class Go:
    """Order to train from an average until so many updates are done.

    A branch that is in this round already goes on where it is.
    """

    average: Path
    until: int


@dataclass(frozen=True, kw_only=True)
class Try:
    """Order to walk the trials with the policy of a checkpoint; `steps`: environment steps behind it."""

    checkpoint: Path
    steps: int


@dataclass(frozen=True, kw_only=True)
class Stop:
    """Order to save after the present update, and to wait."""


@dataclass(frozen=True, kw_only=True)
class Ready:
    """A branch is built, and has done so many updates."""

    update: int
    notice: str


@dataclass(frozen=True, kw_only=True)
class Report:
    """Log of an update."""

    update: int
    log: dict[str, float]


@dataclass(frozen=True, kw_only=True)
class Saved:
    """The last thing of an order: a checkpoint is written, of so many updates."""

    update: int


@dataclass(frozen=True, kw_only=True)
class Tried:
    """What trials gave; `ways`: the figure."""

    steps: int
    results: TrialResults
    ways: Any


@dataclass(frozen=True, kw_only=True)
class Failed:
    """Words of an error that ended a branch."""

    words: str


Order = Begin | Go | Try | Stop
Answer = Ready | Report | Saved | Tried | Failed
