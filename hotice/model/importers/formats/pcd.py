"""Point Cloud Data files (PCD 0.6 and 0.7): `ascii`, `binary` and `binary_compressed`."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hotice.errors import InvalidMap
from hotice.model.importers.formats.lzf import decompress
from hotice.model.importers.formats.records import MAX_HEADER_BYTES, binary_columns, check_count, count_of, text_columns

_TYPES = {("F", 4): "f4", ("F", 8): "f8", **{(t, s): f"{t.lower()}{s}" for t in "IU" for s in (1, 2, 4, 8)}}
_ENCODINGS = ("ascii", "binary", "binary_compressed")


@dataclass(frozen=True, kw_only=True)
class PcdHeader:
    """`fields` (name, numpy type, count) in the file's order; the data begin at byte `size`."""

    fields: tuple[tuple[str, str, int], ...]
    points: int
    encoding: str
    size: int

    @property
    def dtype(self) -> np.dtype:
        """One point of a `binary` file; fields are named by their place, since names may repeat (padding does)."""
        return np.dtype([(f"f{i}", f"<{kind}", (count,)) for i, (_, kind, count) in enumerate(self.fields)])

    @property
    def columns(self) -> list[int]:
        """Places of x, y and z among the fields."""
        names = [name for name, _, _ in self.fields]
        return [names.index(axis) for axis in "xyz"]


def read_pcd(content: bytes) -> NDArray[np.float64]:
    """Points of a PCD file, (n, 3) [the file's unit]; rows that are not finite are kept. Raises `InvalidMap`.

    The viewpoint of the header is the sensor's pose at recording and, as elsewhere, not applied.
    """
    header = read_header(content)
    data = content[header.size :]
    if header.encoding == "ascii":
        starts = np.cumsum([0, *(count for _, _, count in header.fields)])
        return text_columns(data, header.points, int(starts[-1]), [int(starts[c]) for c in header.columns])
    if header.encoding == "binary":
        return binary_columns(data, header.points, header.dtype, [f"f{c}" for c in header.columns])
    return _compressed_columns(data, header)


def read_header(content: bytes) -> PcdHeader:
    """The header. Raises `InvalidMap` for one that is cut, contradicts itself or has no x, y and z."""
    end = content.find(b"\nDATA ", 0, MAX_HEADER_BYTES)
    stop = content.find(b"\n", end + 1, MAX_HEADER_BYTES)
    if end < 0 or stop < 0:
        raise InvalidMap("is not a PCD file: its header has no DATA line")
    entries: dict[str, list[str]] = {}
    for line in content[:stop].decode("ascii", "replace").splitlines():
        words = line.partition("#")[0].split()
        if words:
            entries[words[0].upper()] = words[1:]
    names = entries.get("FIELDS") or entries.get("COLUMNS") or []
    sizes = [count_of("PCD SIZE", v) for v in entries.get("SIZE", [])]
    counts = [count_of("PCD COUNT", v) for v in entries.get("COUNT", ["1"] * len(names))]
    types = entries.get("TYPE", [])
    if not names or not len(names) == len(sizes) == len(types) == len(counts):
        raise InvalidMap(
            f"PCD header has {len(names)} FIELDS, {len(sizes)} SIZE, {len(types)} TYPE and {len(counts)} COUNT "
            "entries: as many of each are needed"
        )
    fields = []
    for name, kind, size, count in zip(names, types, sizes, counts, strict=True):
        if (kind, size) not in _TYPES or not 1 <= count <= 10_000:
            raise InvalidMap(f"PCD field {name!r} has type {kind!r}, size {size}, count {count}: no such numbers exist")
        fields.append((name, _TYPES[kind, size], count))
    missing = [axis for axis in "xyz" if axis not in names]
    if missing:
        raise InvalidMap(f"PCD fields are {', '.join(names[:20])}: {', '.join(missing)} are missing")
    encoding = " ".join(entries["DATA"]).lower() if "DATA" in entries else ""
    if encoding not in _ENCODINGS:
        raise InvalidMap(f"PCD data are {encoding[:40]!r}: known are {', '.join(_ENCODINGS)}")
    grid = [count_of(f"PCD {key}", entries[key][0]) for key in ("WIDTH", "HEIGHT") if entries.get(key)]
    if not entries.get("POINTS") and len(grid) < 2:
        raise InvalidMap("PCD header lacks POINTS")
    points = count_of("PCD POINTS", entries["POINTS"][0]) if entries.get("POINTS") else math.prod(grid)
    if len(grid) == 2 and math.prod(grid) != points:
        raise InvalidMap(f"PCD header has {grid[0]} x {grid[1]} points and {points} POINTS: they must agree")
    check_count(points)
    return PcdHeader(fields=tuple(fields), points=points, encoding=encoding, size=stop + 1)


def _compressed_columns(data: bytes, header: PcdHeader) -> NDArray[np.float64]:
    """Two sizes, then all values of the first field, all of the second, and so on, compressed together."""
    if len(data) < 8:
        raise InvalidMap("is cut short: the sizes of its compressed data are missing")
    packed_size, size = (int(v) for v in np.frombuffer(data, "<u4", 2))
    widths = [np.dtype(kind).itemsize * count for _, kind, count in header.fields]
    if size != header.points * sum(widths):
        raise InvalidMap(
            f"compressed data claim {size:,} bytes: {header.points:,} points need {header.points * sum(widths):,}"
        )
    if packed_size > len(data) - 8:
        raise InvalidMap(f"is cut short: {packed_size:,} bytes of compressed data announced, {len(data) - 8:,} there")
    flat = decompress(data[8 : 8 + packed_size], size)
    starts = header.points * np.cumsum([0, *widths])
    points = np.empty((header.points, 3))
    for axis, c in enumerate(header.columns):
        _, kind, count = header.fields[c]
        values = np.frombuffer(flat, f"<{kind}", header.points * count, int(starts[c]))
        points[:, axis] = values[::count]
    return points
