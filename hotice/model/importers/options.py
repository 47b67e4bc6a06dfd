"""Options of a map or a house that becomes scenes, as a user gives them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from hotice import checks
from hotice.checks import Range
from hotice.errors import InvalidConfig
from hotice.model.geometry.lengths import LARGE_M

FARTHEST_M = 100_000_000
FAR_M = 1000.0
"""A map farther from its origin is a surveyor's: its scene has an origin of its own."""
Size = tuple[float, float, float]
Up = Literal["auto", "x", "y", "z", "-x", "-y", "-z"]


@dataclass(frozen=True, kw_only=True)
class ImportOptions:
    """Options of turning a map into a scene. Raises `InvalidConfig`."""

    start: tuple[float, ...]
    """x, y [m] and, optionally, yaw [rad]; without yaw the robot faces the goal."""
    goal: tuple[float, float]
    """x, y [m]."""
    frame: Literal["floor", "map"] = "floor"
    """What start and goal refer to: the level frame that the scene gets, or the map's own (after unit, up axis and
    turn).

    Farther than 1 km from the map's origin only `map` is possible; the scene then has its origin at the start."""
    size_m: tuple[float, float, float] | None = None
    """Extent of the crop about the middle of start and goal; by default 1 m beyond both, 1.5 m high."""
    voxel_m: float = 0.04
    """Edge of the voxels that boxes are made of."""
    up: Up = "auto"
    """The map's axis that points up; auto: y for GLB, else z, or -z for a cloud that is upside down."""
    turn_deg: tuple[float, float] = (0.0, 0.0)
    """Roll and pitch [degrees]: the map is turned by them about its x, then its y axis; for sensors mounted at a
    slant."""
    scale: float = 1.0
    """Metres per unit of the file."""
    floor: Literal["fit", "given"] = "fit"
    """Find the floor, or take z = 0 as it is."""
    min_points: int = 0
    """Points of a cloud that make a voxel solid; 0: 1 to 3, by the cloud's density."""
    min_voxels: int = 6
    """Smaller groups of a cloud's voxels are specks."""
    name: str = ""
    """Name of the scene; by default the file's."""

    def __post_init__(self) -> None:
        checks.vector("turn_deg", self.turn_deg, 2, Range(least=-10_000, most=10_000))
        if self.size_m is not None:
            checks.vector("size_m", self.size_m, 3, Range(least=-10_000, most=10_000))
        checks.vector("start", self.start, None, Range(least=-FARTHEST_M, most=FARTHEST_M))
        checks.vector("goal", self.goal, 2, Range(least=-FARTHEST_M, most=FARTHEST_M))
        if len(self.start) not in (2, 3):
            raise InvalidConfig(f"start is {self.start!r}: X Y or X Y YAW is needed")
        if self.frame == "floor" and max(map(abs, (*self.start[:2], *self.goal))) > FAR_M:
            raise InvalidConfig(
                f"start {self.start!r} or goal {self.goal!r} is more than {FAR_M:g} m from the origin: give them as "
                "the map has them and add --frame map, by which the scene has its origin at the start"
            )
        checks.number("voxel_m", self.voxel_m, Range(least=0.01, most=0.2, unit="m"))
        checks.number("scale", self.scale, Range(least=1e-4, most=10_000, note="0.001 for millimetres"))
        checks.whole("min_points", self.min_points, checks.NOT_NEGATIVE)
        checks.whole("min_voxels", self.min_voxels, checks.COUNT)


@dataclass(frozen=True, kw_only=True)
class Front3dConfig:
    """Scenes from one house of the 3D-FRONT data set."""

    house: Path
    """JSON file of the house."""
    models: tuple[Path, ...]
    """Folders of models, <jid>/raw_model.obj; several where the data set came in parts."""
    out: Path = Path("scenes")
    """Folder for one file per scene and the meshes that they share."""
    count: int = 10
    """Scenes wanted."""
    seed: int = 0
    """Seed of the order in which ways are tried."""
    size_m: Size = LARGE_M
    """Along the way, across, up."""
