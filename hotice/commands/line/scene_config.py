"""Options of `hotice scene`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from hotice import checks
from hotice.checks import Range
from hotice.deploy.simulated.lidar_map import LidarScan
from hotice.errors import InvalidConfig
from hotice.model.importers.options import ImportOptions

Items = Annotated[tuple[str, ...], tyro.conf.Positional]


@dataclass(frozen=True, kw_only=True)
class ImportConfig(ImportOptions):
    """One import."""

    map: tyro.conf.Positional[Path]
    """Point cloud (.pcd, .ply), octree (.bt of OctoMap) or mesh (.obj, .stl, .off, .glb, .ply)."""
    out: Path = Path("scene.json")
    """Scene file to write; a picture `.png` of what was kept is written beside it."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.out.suffix != ".json":
            raise InvalidConfig(f"out is {str(self.out)!r}: a .json file is needed")


@dataclass(frozen=True, kw_only=True)
class ShowConfig:
    """Scenes to look at."""

    scenes: Items
    """Names, files, folders or family:NAME:COUNT[:SEED]; several are laid out side by side."""
    html: Path | None = None
    """Write the page here and return, instead of serving it until Ctrl-C."""
    port: int = 7000
    """Port on this machine; 0: any free one."""
    arrows: bool = False
    """Draw both guidance fields at pelvis height."""
    robot: bool = True
    """Draw the robot where it starts."""

    def __post_init__(self) -> None:
        checks.whole("port", self.port, Range(least=0, most=65535))


@dataclass(frozen=True, kw_only=True)
class GenerateConfig:
    """Scenes to generate."""

    families: Items
    """family:NAME:COUNT[:SEED]."""
    out: Path = Path("scenes")
    """Folder for one file per scene."""


@dataclass(frozen=True, kw_only=True)
class CheckConfig:
    """Scenes to check."""

    scenes: Items
    """Names, files, folders or family:NAME:COUNT[:SEED]."""


@dataclass(frozen=True, kw_only=True)
class ScanConfig(LidarScan):
    """One map of a scene."""

    scene: tyro.conf.Positional[str]
    """Scene name or file."""
    out: Path = Path("scan.pcd")
    """Point cloud to write."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.out.suffix != ".pcd":
            raise InvalidConfig(f"out is {str(self.out)!r}: a .pcd file is needed")
