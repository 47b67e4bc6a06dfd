"""Flat vectors with named parts: what ports and files carry, and what mathematics reads by name, without a copy."""

from __future__ import annotations

from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray


class NamedVector:
    """One float64 vector; each name in `SHAPES` is an attribute that views its part.

    `vector` (SIZE,) is kept, not copied. Build from parts with `of`.
    """

    SHAPES: ClassVar[dict[str, tuple[int, ...]]] = {}
    SIZE: ClassVar[int] = 0
    PARTS: ClassVar[dict[str, slice]] = {}
    __slots__ = ("vector",)

    def __init__(self, vector: NDArray[np.float64]) -> None:
        self.vector = vector

    def __init_subclass__(cls) -> None:
        ends = np.cumsum([0, *(int(np.prod(shape)) for shape in cls.SHAPES.values())]).tolist()
        cls.PARTS = {name: slice(a, b) for name, a, b in zip(cls.SHAPES, ends[:-1], ends[1:], strict=True)}
        cls.SIZE = ends[-1]
        for name, shape in cls.SHAPES.items():
            setattr(cls, name, _part(cls.PARTS[name], shape))

    @classmethod
    def of(cls, **parts: Any) -> Self:
        """From all parts by name. Raises `TypeError` when one is missing or unknown."""
        if parts.keys() != cls.SHAPES.keys():
            raise TypeError(f"{cls.__name__} of {', '.join(parts)}: exactly {', '.join(cls.SHAPES)} are needed")
        vector = np.empty(cls.SIZE)
        for name, where in cls.PARTS.items():
            vector[where] = np.ravel(parts[name])
        return cls(vector)


def _part(where: slice, shape: tuple[int, ...]) -> property:
    if len(shape) == 1:
        return property(lambda self: self.vector[where])
    return property(lambda self: self.vector[where].reshape(shape))
