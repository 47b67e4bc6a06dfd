"""Obstacle shapes and their exact signed distance, in the shape's own frame [m]; negative inside.

Cylinders and capsules lie along local z, centred; `length_m` of a capsule is its cylindrical part. A mesh keeps its
file's frame, scaled about the origin.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from hotice import checks
from hotice.checks import shown
from hotice.errors import InvalidScene
from hotice.model.geometry.lengths import LENGTH

Points = NDArray[np.float64]
MESH_SUFFIXES = (".obj", ".off", ".ply", ".stl")


class Shape:
    """Base of the obstacle shapes. `type` is the word used in scene files, `keys` the entries beside it."""

    type: ClassVar[str]
    keys: ClassVar[tuple[str, ...]]

    def to_dict(self) -> dict[str, Any]:
        """The `shape` entry of a scene file."""
        values = {key: getattr(self, key) for key in self.keys}
        return {"type": self.type} | {k: list(v) if isinstance(v, tuple) else v for k, v in values.items()}

    def signed_distance(self, p: Points) -> Points:
        """(..., 3) in the shape's frame [m] -> (...) [m], negative inside."""
        raise NotImplementedError

    def bounding_ball(self) -> tuple[NDArray[np.float64], float]:
        """Centre (3,) in the shape's frame and radius [m] of a ball that holds the shape."""
        raise NotImplementedError

    def mujoco_geom(self) -> tuple[str, tuple[float, ...]]:
        """MuJoCo geom type and size [m]: half extents, or radius and half length along z. A mesh has none."""
        raise InvalidScene(f"a {self.type} shape has no MuJoCo primitive: use its triangles")


@dataclass(frozen=True)
class BoxShape(Shape):
    """A cuboid of full extent `size_m`."""

    size_m: tuple[float, float, float]
    type: ClassVar[str] = "box"
    keys: ClassVar[tuple[str, ...]] = ("size_m",)

    def __post_init__(self) -> None:
        object.__setattr__(self, "size_m", checks.vector("box size_m", self.size_m, 3, LENGTH, InvalidScene))

    def signed_distance(self, p: Points) -> Points:
        """Exact, see `Shape`."""
        q = np.abs(p) - 0.5 * np.array(self.size_m)
        return np.linalg.norm(np.maximum(q, 0.0), axis=-1) + np.minimum(q.max(axis=-1), 0.0)

    def bounding_ball(self) -> tuple[NDArray[np.float64], float]:
        """See `Shape`."""
        return np.zeros(3), 0.5 * math.hypot(*self.size_m)

    def mujoco_geom(self) -> tuple[str, tuple[float, ...]]:
        """See `Shape`."""
        return "box", tuple(0.5 * v for v in self.size_m)


@dataclass(frozen=True)
class CylinderShape(Shape):
    """A flat-ended cylinder along local z."""

    radius_m: float
    length_m: float
    type: ClassVar[str] = "cylinder"
    keys: ClassVar[tuple[str, ...]] = ("radius_m", "length_m")

    def __post_init__(self) -> None:
        _check_lengths(self)

    def signed_distance(self, p: Points) -> Points:
        """Exact, see `Shape`."""
        radial = np.hypot(p[..., 0], p[..., 1]) - self.radius_m
        axial = np.abs(p[..., 2]) - 0.5 * self.length_m
        outside = np.hypot(np.maximum(radial, 0.0), np.maximum(axial, 0.0))
        return outside + np.minimum(np.maximum(radial, axial), 0.0)

    def bounding_ball(self) -> tuple[NDArray[np.float64], float]:
        """See `Shape`."""
        return np.zeros(3), math.hypot(self.radius_m, 0.5 * self.length_m)

    def mujoco_geom(self) -> tuple[str, tuple[float, ...]]:
        """See `Shape`."""
        return "cylinder", (self.radius_m, 0.5 * self.length_m)


@dataclass(frozen=True)
class CapsuleShape(Shape):
    """A capsule along local z; `length_m` is the distance between the centres of its caps."""

    radius_m: float
    length_m: float
    type: ClassVar[str] = "capsule"
    keys: ClassVar[tuple[str, ...]] = ("radius_m", "length_m")

    def __post_init__(self) -> None:
        _check_lengths(self)

    def signed_distance(self, p: Points) -> Points:
        """Exact, see `Shape`."""
        half = 0.5 * self.length_m
        along = p[..., 2] - np.clip(p[..., 2], -half, half)
        return np.sqrt(p[..., 0] ** 2 + p[..., 1] ** 2 + along**2) - self.radius_m

    def bounding_ball(self) -> tuple[NDArray[np.float64], float]:
        """See `Shape`."""
        return np.zeros(3), self.radius_m + 0.5 * self.length_m

    def mujoco_geom(self) -> tuple[str, tuple[float, ...]]:
        """See `Shape`."""
        return "capsule", (self.radius_m, 0.5 * self.length_m)


@dataclass(frozen=True)
class SphereShape(Shape):
    """A ball."""

    radius_m: float
    type: ClassVar[str] = "sphere"
    keys: ClassVar[tuple[str, ...]] = ("radius_m",)

    def __post_init__(self) -> None:
        _check_lengths(self)

    def signed_distance(self, p: Points) -> Points:
        """Exact, see `Shape`."""
        return np.linalg.norm(p, axis=-1) - self.radius_m

    def bounding_ball(self) -> tuple[NDArray[np.float64], float]:
        """See `Shape`."""
        return np.zeros(3), self.radius_m

    def mujoco_geom(self) -> tuple[str, tuple[float, ...]]:
        """See `Shape`."""
        return "sphere", (self.radius_m,)


@dataclass(frozen=True)
class MeshShape(Shape):
    """A watertight triangle mesh in `folder / file`, scaled by `scale`.

    `file` is relative and must stay inside `folder`, also through symbolic links. Raises `InvalidScene` when the file
    is missing, of another format, outside the folder, unreadable or not watertight (the last two when first used).
    """

    file: str
    scale: float = 1.0
    folder: Path = Path(".")
    type: ClassVar[str] = "mesh"
    keys: ClassVar[tuple[str, ...]] = ("file", "scale")

    def __post_init__(self) -> None:
        object.__setattr__(self, "scale", checks.number("mesh scale", self.scale, LENGTH, InvalidScene))
        object.__setattr__(self, "folder", Path(self.folder))
        if not isinstance(self.file, str) or not self.file or "\0" in self.file:
            raise InvalidScene(f"mesh file is {shown(self.file)}: a path relative to the scene file is needed")
        name = shown(self.file)
        if Path(self.file).suffix.lower() not in MESH_SUFFIXES:
            raise InvalidScene(f"mesh file {name} is of an unknown format: known are {', '.join(MESH_SUFFIXES)}")
        try:
            inside = self.path.is_relative_to(self.folder.resolve())
            found = inside and self.path.is_file()
        except (OSError, RuntimeError, ValueError) as error:  # a loop of links; text that is no file name
            raise InvalidScene(f"mesh file {name} cannot be resolved: {error}") from None
        if not inside:
            raise InvalidScene(f"mesh file {name} lies outside the scene's folder: copy it into that")
        if not found:
            raise InvalidScene(f"mesh file {name} is missing in {self.folder.resolve()}")

    @property
    def path(self) -> Path:
        """The file with links and `..` resolved."""
        return (self.folder / self.file).resolve()

    def mesh(self):
        """The loaded, scaled `hotice.model.geometry.meshes.TriangleMesh`; read once while the file stays unchanged."""
        from hotice.model.geometry.meshes import load_mesh

        return load_mesh(self.path, self.scale)

    def signed_distance(self, p: Points) -> Points:
        """Exact, see `Shape`."""
        return self.mesh().signed_distance(p)

    def bounding_ball(self) -> tuple[NDArray[np.float64], float]:
        """See `Shape`."""
        return self.mesh().ball

    def triangles(self) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Vertices (V, 3) in the shape's frame [m], scaled, and faces (F, 3), counter-clockwise seen from outside."""
        mesh = self.mesh()
        return mesh.vertices, mesh.faces


def _check_lengths(shape: Any) -> None:
    for key in shape.keys:
        length = checks.number(f"{shape.type} {key}", getattr(shape, key), LENGTH, InvalidScene)
        object.__setattr__(shape, key, length)


SHAPES: dict[str, Callable[..., Shape]] = {
    kind.type: kind for kind in (BoxShape, CylinderShape, CapsuleShape, SphereShape, MeshShape)
}


def shape_from_dict(data: Mapping[str, Any], folder: Path | None = None) -> Shape:
    """Shape of a scene file's `shape` entry; mesh files are looked up in `folder`. Raises `InvalidScene`."""
    if not isinstance(data, Mapping) or "type" not in data:
        raise InvalidScene(f"shape is {shown(data)}: a mapping with a type is needed ({', '.join(SHAPES)})")
    kind = checks.one_of("shape type", data["type"], SHAPES, InvalidScene)
    cls: Any = SHAPES[kind]
    if cls is MeshShape:
        checks.mapping("mesh shape", data, ("type", "file"), ("scale",), InvalidScene)
        if folder is None:
            raise InvalidScene("a mesh needs the scene's folder: load the scene from a file, or pass folder=")
        return MeshShape(data["file"], data.get("scale", 1.0), folder)
    checks.mapping(f"{kind} shape", data, ("type", *cls.keys), error=InvalidScene)
    return cls(**{key: data[key] for key in cls.keys})


def signed_distance(shape: Shape, p_local: Points) -> Points:
    """Exact signed distance, (..., 3) in the shape's frame [m] -> (...) [m], negative inside."""
    return shape.signed_distance(np.asarray(p_local, dtype=np.float64))
