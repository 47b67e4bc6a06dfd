"""Options of `hotice tags` and `hotice tag-camera`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from hotice import checks
from hotice.checks import Range
from hotice.commands.robot_sim_config import PORT
from hotice.deploy.sources.udp import LOCALHOST, TAGS_PORT
from hotice.deploy.tags.bundle import FIRST_ID
from hotice.errors import InvalidConfig


@dataclass(frozen=True, kw_only=True)
class TagsConfig:
    """Sheets of tags for one box."""

    box: tuple[float, float, float]
    """Sides [m]: ahead of the robot, across, up; each at least 0.14."""
    out: Path
    """PDF file to write, a page of A4 for each face."""
    first_id: int = 0
    """Id of the first of its eight tags: boxes that may be seen together need each their own ids (0, 8, 16, …)."""

    def __post_init__(self) -> None:
        checks.vector("box", self.box, 3, checks.POSITIVE)
        checks.whole("first_id", self.first_id, FIRST_ID)
        if self.out.suffix != ".pdf":
            raise InvalidConfig(f"out is {str(self.out)!r}: the sheets are a .pdf file")


@dataclass(frozen=True, kw_only=True)
class TagCameraConfig:
    """One camera whose pictures are searched for tags."""

    camera: str
    """`realsense` (never tried on one), or a folder of pictures of 640 × 480, in the order of their names."""
    first_id: int = 0
    """Id of the first of the box's eight tags, as it was printed; others are left out."""
    rate_hz: int = 30
    """Pictures a second."""
    host: str = LOCALHOST
    """Address to which corners of tags are sent."""
    port: int = TAGS_PORT
    """UDP port of it."""
    duration_s: float | None = None
    """Ends after so long [s]; without it by Ctrl-C, or with the folder's last picture."""

    def __post_init__(self) -> None:
        checks.whole("first_id", self.first_id, FIRST_ID)
        checks.whole("rate_hz", self.rate_hz, Range(least=1, most=1000))
        checks.whole("port", self.port, PORT)
        if self.duration_s is not None:
            checks.number("duration_s", self.duration_s, checks.POSITIVE)
