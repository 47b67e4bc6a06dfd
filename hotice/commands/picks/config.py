"""Options of `hotice pickup plan`."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from hotice import checks
from hotice.control.playback.draw import PickRange
from hotice.errors import InvalidConfig


@dataclass(frozen=True, kw_only=True)
class PlanConfig:
    """One book of picks; needs the extra `drake`."""

    out: Path = Path("picks.npz")
    """Book to write."""
    count: int = 64
    """Picks in it; planning one takes some seconds."""
    seed: int = 0
    """Seed of objects and places."""
    draws: PickRange = field(default_factory=PickRange)
    """What is drawn."""

    def __post_init__(self) -> None:
        checks.whole("count", self.count, checks.COUNT)
        checks.whole("seed", self.seed, checks.INT64)
        if self.out.suffix != ".npz":
            raise InvalidConfig(f"out is {str(self.out)!r}: a .npz file is needed")
