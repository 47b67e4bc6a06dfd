"""Carried objects: uniform boxes, cylinders and spheres, with the eight keypoints at which the OGF is queried (IV-A).

The object frame O sits at the centre of mass; a cylinder lies along its local z.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from hotice import checks
from hotice.errors import InvalidObject

ShapeName = Literal["box", "cylinder", "sphere"]
OCTANTS: NDArray[np.float64] = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))
"""(8, 3) signs of the corners, z fastest."""


class _Carried:
    """Base of the three shapes. `keypoints_world_aligned`: keypoints keep world directions when the object turns."""

    shape: ClassVar[ShapeName]
    keypoints_world_aligned: ClassVar[bool] = False
    mass_kg: float

    def _check(self, *lengths: str) -> None:
        for key in (*lengths, "mass_kg"):
            value = checks.number(f"{self.shape}: {key}", getattr(self, key), checks.POSITIVE, InvalidObject)
            object.__setattr__(self, key, value)


@dataclass(frozen=True)
class Box(_Carried):
    """A cuboid of full extent `size_m` (x, y, z). Raises `InvalidObject` unless every number is finite and positive."""

    size_m: tuple[float, float, float]
    mass_kg: float
    shape: ClassVar[ShapeName] = "box"

    def __post_init__(self) -> None:
        size = checks.vector("box: size_m", self.size_m, 3, checks.POSITIVE, InvalidObject)
        object.__setattr__(self, "size_m", size)
        self._check()

    def keypoints(self) -> NDArray[np.float64]:
        """The corners, (8, 3) in O [m]."""
        return OCTANTS * self.half_extents_m

    @property
    def half_extents_m(self) -> NDArray[np.float64]:
        """Half of the bounding box in O, (3,) [m]."""
        return 0.5 * np.array(self.size_m)

    @property
    def volume_m3(self) -> float:
        """Volume [m^3]."""
        return float(np.prod(self.size_m))

    @property
    def inertia_diag_kgm2(self) -> NDArray[np.float64]:
        """Principal moments about the centre in O, (3,), of uniform density."""
        sq = np.square(self.size_m)
        return self.mass_kg / 12.0 * (sq.sum() - sq)

    def mujoco_geom(self) -> tuple[str, tuple[float, ...]]:
        """MuJoCo type and size (half extents)."""
        return "box", tuple(float(v) for v in self.half_extents_m)

    def to_dict(self) -> dict[str, Any]:
        """Plain values, the input of `object_from_dict`."""
        return {"shape": self.shape, "size_m": list(self.size_m), "mass_kg": self.mass_kg}


@dataclass(frozen=True)
class Cylinder(_Carried):
    """A solid cylinder along its local z. Raises `InvalidObject` unless every number is finite and positive."""

    radius_m: float
    length_m: float
    mass_kg: float
    shape: ClassVar[ShapeName] = "cylinder"

    def __post_init__(self) -> None:
        self._check("radius_m", "length_m")

    def keypoints(self) -> NDArray[np.float64]:
        """Four points of each rim (at ± 45 and ± 135 degrees), signs ordered as `OCTANTS`, (8, 3) in O [m]."""
        return OCTANTS * np.array([self.radius_m / math.sqrt(2.0), self.radius_m / math.sqrt(2.0), 0.5 * self.length_m])

    @property
    def half_extents_m(self) -> NDArray[np.float64]:
        """Half of the bounding box in O, (3,) [m]."""
        return np.array([self.radius_m, self.radius_m, 0.5 * self.length_m])

    @property
    def volume_m3(self) -> float:
        """Volume [m^3]."""
        return math.pi * self.radius_m**2 * self.length_m

    @property
    def inertia_diag_kgm2(self) -> NDArray[np.float64]:
        """Principal moments about the centre in O, (3,), of uniform density."""
        side = self.mass_kg * (3.0 * self.radius_m**2 + self.length_m**2) / 12.0
        return np.array([side, side, 0.5 * self.mass_kg * self.radius_m**2])

    def mujoco_geom(self) -> tuple[str, tuple[float, ...]]:
        """MuJoCo type and size (radius, half length)."""
        return "cylinder", (self.radius_m, 0.5 * self.length_m)

    def to_dict(self) -> dict[str, Any]:
        """Plain values, the input of `object_from_dict`."""
        return {"shape": self.shape, "radius_m": self.radius_m, "length_m": self.length_m, "mass_kg": self.mass_kg}


@dataclass(frozen=True)
class Sphere(_Carried):
    """A solid ball, whose keypoints are fixed world directions. Raises `InvalidObject` unless finite and positive."""

    radius_m: float
    mass_kg: float
    shape: ClassVar[ShapeName] = "sphere"
    keypoints_world_aligned: ClassVar[bool] = True

    def __post_init__(self) -> None:
        self._check("radius_m")

    def keypoints(self) -> NDArray[np.float64]:
        """The octant directions times the radius, (8, 3) [m] from the centre in *world* axes: p_WK = p_WO + row."""
        return OCTANTS * (self.radius_m / math.sqrt(3.0))

    @property
    def half_extents_m(self) -> NDArray[np.float64]:
        """Half of the bounding box in O, (3,) [m]."""
        return np.full(3, self.radius_m)

    @property
    def volume_m3(self) -> float:
        """Volume [m^3]."""
        return 4.0 / 3.0 * math.pi * self.radius_m**3

    @property
    def inertia_diag_kgm2(self) -> NDArray[np.float64]:
        """Principal moments about the centre, (3,), of uniform density."""
        return np.full(3, 0.4 * self.mass_kg * self.radius_m**2)

    def mujoco_geom(self) -> tuple[str, tuple[float, ...]]:
        """MuJoCo type and size (radius)."""
        return "sphere", (self.radius_m,)

    def to_dict(self) -> dict[str, Any]:
        """Plain values, the input of `object_from_dict`."""
        return {"shape": self.shape, "radius_m": self.radius_m, "mass_kg": self.mass_kg}


CarriedObject = Box | Cylinder | Sphere
_KEYS: dict[str, tuple[type, tuple[str, ...]]] = {
    "box": (Box, ("size_m", "mass_kg")),
    "cylinder": (Cylinder, ("radius_m", "length_m", "mass_kg")),
    "sphere": (Sphere, ("radius_m", "mass_kg")),
}


def object_from_dict(data: Mapping[str, Any]) -> CarriedObject:
    """Inverse of `.to_dict()`. Raises `InvalidObject` for an unknown shape or missing, unknown or impossible values."""
    if not isinstance(data, Mapping):
        raise InvalidObject(f"object is {checks.shown(data)}: a mapping with shape and sizes is needed")
    shape = checks.one_of("object shape", data.get("shape"), _KEYS, InvalidObject)
    kind, keys = _KEYS[shape]
    checks.mapping(f"{shape} object", data, ("shape", *keys), error=InvalidObject)
    return kind(**{key: data[key] for key in keys})
