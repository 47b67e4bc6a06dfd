"""Random carried objects: what training and benchmarks draw from (paper, V-A: at most 3.5 kg and a 40 cm cube)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hotice import checks
from hotice.errors import InvalidObject
from hotice.model.objects import Box, CarriedObject, Cylinder, Sphere

SHAPES = ("box", "cylinder", "sphere")


@dataclass(frozen=True, kw_only=True)
class ObjectRange:
    """Uniform ranges of shape, size and mass; every extent of an object is drawn on its own.

    What arms cannot hold is drawn anew by those who carry: of the default range under 1 in 100, small heavy spheres.
    """

    shapes: tuple[str, ...] = ("box",)
    size_m: tuple[float, float] = (0.20, 0.40)
    """Smallest and largest full extent [m] (paper: at most 0.40)."""
    mass_kg: tuple[float, float] = (0.5, 3.5)
    """Lightest and heaviest [kg] (paper: at most 3.5)."""

    def __post_init__(self) -> None:
        if not isinstance(self.shapes, list | tuple) or not self.shapes:
            known = ", ".join(SHAPES)
            raise InvalidObject(f"object shapes is {checks.shown(self.shapes)}: one or more of {known} are needed")
        for shape in self.shapes:
            checks.one_of("object shape", shape, SHAPES, InvalidObject)
        for name in ("size_m", "mass_kg"):
            ends = checks.interval(f"object {name}", getattr(self, name), checks.POSITIVE, InvalidObject)
            object.__setattr__(self, name, ends)

    def sample(self, rng: np.random.Generator) -> CarriedObject:
        """One object, drawn with `rng`."""
        shape = self.shapes[int(rng.integers(len(self.shapes)))]
        x, y, z = (float(v) for v in rng.uniform(*self.size_m, 3))
        mass = float(rng.uniform(*self.mass_kg))
        if shape == "box":
            return Box((x, y, z), mass)
        return Cylinder(x / 2, z, mass) if shape == "cylinder" else Sphere(x / 2, mass)
