"""Evaluation of pick-ups in numbers."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from hotice import checks
from hotice.errors import InvalidConfig

TEACHER = "teacher"
"""Stands for the playback of the book with the true state in sight."""


@dataclass(frozen=True, kw_only=True)
class PickEvaluateConfig:
    """One evaluation of pick-ups."""

    policy: str = TEACHER
    """Checkpoint folder, run or .onnx file; `teacher`: the book itself, played back with the true state in sight."""
    picks: Path = Path("picks.npz")
    """Book of picks; for fair numbers none that the policy was trained on."""
    rollouts: int = 100
    """Trials; the picks of the book in turn."""
    seed: int = 0
    """Seed of noise and robots."""
    perturbed: bool = True
    """Noise, delays and uncertain dynamics as for students, else the nominal robot of the protocol."""
    threads: int = 0
    """Threads of physics and torch; 0: all cores that this process may use."""
    out: Path | None = None
    """Report file (JSON)."""

    def __post_init__(self) -> None:
        checks.whole("rollouts", self.rollouts, checks.COUNT)
        checks.wholes(self, checks.INT64, "seed", "threads")
        if self.out is not None and self.out.suffix != ".json":
            raise InvalidConfig(f"out is {str(self.out)!r}: a .json file is needed")
