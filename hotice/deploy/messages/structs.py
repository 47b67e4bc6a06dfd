"""A message as a table of fields, and what follows from it: the C struct, and the places of its bytes on the wire.

One table per message serves the NumPy record (C layout, over which the checksum runs), the CDR encoding and the DDS
type, so that a check of the type against the robot's checks the two others too.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

SCALARS = {"u8": "<u1", "u16": "<u2", "i16": "<i2", "u32": "<u4", "i32": "<i4", "f32": "<f4"}
"""Primitive types of the tables, as NumPy writes them: little-endian, as the robot's processors are."""


class Field(NamedTuple):
    """One line of a message: `count` values of a scalar (a key of `SCALARS`) or of another struct, in a row."""

    name: str
    kind: str | Struct
    count: int = 1


class Primitive(NamedTuple):
    """One number of a message: its path from the top, its place in the C struct and its size [bytes]."""

    path: tuple[str | int, ...]
    kind: str
    offset: int
    size: int


@dataclass(frozen=True, eq=False)
class Struct:
    """A message or a part of one, its fields in the order of the vendor's definition."""

    name: str
    fields: tuple[Field, ...]

    @cached_property
    def dtype(self) -> np.dtype:
        """The C struct, padding included."""
        rows = []
        for field in self.fields:
            base = field.kind.dtype if isinstance(field.kind, Struct) else SCALARS[field.kind]
            rows.append((field.name, base) if field.count == 1 else (field.name, base, (field.count,)))
        return np.dtype(rows, align=True)

    def zeros(self) -> np.ndarray:
        """A record () of this struct, all bytes zero, its padding too."""
        return np.zeros((), self.dtype)

    @cached_property
    def primitives(self) -> tuple[Primitive, ...]:
        """Every number in the order of the definition, which is the order on the wire."""
        return tuple(self._walk((), 0))

    def _walk(self, path: tuple[str | int, ...], start: int) -> Iterator[Primitive]:
        places = {name: place for name, (_, place, *_) in (self.dtype.fields or {}).items()}
        for field in self.fields:
            offset = start + places[field.name]
            for i in range(field.count):
                here = (*path, field.name) if field.count == 1 else (*path, field.name, i)
                if isinstance(field.kind, Struct):
                    yield from field.kind._walk(here, offset + i * field.kind.dtype.itemsize)
                else:
                    size = np.dtype(SCALARS[field.kind]).itemsize
                    yield Primitive(here, field.kind, offset + i * size, size)

    @cached_property
    def wire_places(self) -> np.ndarray:
        """Place in the C struct of each byte on the wire, (wire size,); padding comes from one byte past its end.

        CDR aligns each number to its own size and nothing to the size of a struct, so that arrays of structs differ.
        """
        places: list[int] = []
        for primitive in self.primitives:
            padding = -len(places) % primitive.size
            places += [self.dtype.itemsize] * padding
            places += range(primitive.offset, primitive.offset + primitive.size)
        return np.array(places)

    @cached_property
    def record_places(self) -> np.ndarray:
        """Place on the wire of each byte of the C struct, (C size,); padding comes from one byte past its end."""
        wire = self.wire_places
        places = np.full(self.dtype.itemsize, len(wire))
        from_struct = wire < self.dtype.itemsize
        places[wire[from_struct]] = np.flatnonzero(from_struct)
        return places
