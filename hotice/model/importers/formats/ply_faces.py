"""Faces of Stanford PLY files: ascii and binary, polygons of any size beside other properties."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hotice.errors import InvalidMap
from hotice.model.importers.formats.ply import ORDERS, PlyHeader, read_header
from hotice.model.importers.polygons import BadPolygon, fill, fill_flat

_NAMES = ("vertex_indices", "vertex_index")
Columns = dict[str, Any]
"""Values of an element's properties, one a row: a number, or a list of numbers; lists of one length as an array (n,
k)."""


def read_ply_mesh(content: bytes) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Vertices (V, 3) [the file's unit], which may be not finite, and triangles (F, 3). Raises `InvalidMap`."""
    header = read_header(content)
    missing = [axis for axis in "xyz" if header.elements.get("vertex", (0, {}))[1].get(axis, "") == ""]
    if missing:
        raise InvalidMap(f"PLY vertices lack {', '.join(missing)}")
    read = _text(content[header.size :], header) if header.encoding == "ascii" else _binary(content, header)
    found = {name: read(name, count) for name, (count, _) in header.elements.items()}
    vertices = np.stack([np.asarray(found["vertex"][axis], dtype=np.float64) for axis in "xyz"], axis=1)
    faces = next((found["face"][name] for name in _NAMES if name in found.get("face", {})), None)
    if faces is None or header.elements["face"][1][next(n for n in _NAMES if n in found["face"])] != "":
        raise InvalidMap(f"PLY faces lack a list {' or '.join(_NAMES)}")
    try:
        if isinstance(faces, np.ndarray):
            flat = faces.astype(np.int64).reshape(-1)
            return vertices, fill_flat(vertices, flat, np.full(len(faces), faces.shape[1]))
        return vertices, fill(vertices, [list(map(int, face)) for face in faces])
    except BadPolygon as bad:
        raise InvalidMap(f"face {bad.number + 1} {bad}") from None


def _text(data: bytes, header: PlyHeader) -> Callable[[str, int], Columns]:
    """A reader of one element after the other from the words of an ascii file."""
    words, at = data.split(), 0

    def read(element: str, count: int) -> Columns:
        nonlocal at
        properties = header.elements[element][1]
        columns: Columns = {name: [] for name in properties}
        if "" not in properties.values():
            width, end = len(properties), at + count * len(properties)
            if end > len(words):
                raise InvalidMap(f"is cut short: {count:,} rows of {element!r} announced")
            try:
                table = np.array(words[at:end], dtype=np.bytes_).astype(np.float64).reshape(count, width)
            except ValueError:
                raise InvalidMap(f"has text among the numbers of element {element!r}") from None
            at = end
            return dict(zip(properties, table.T, strict=True))
        try:
            for _ in range(count):
                for name, kind in properties.items():
                    size = 1 if kind else int(words[at])
                    if not 0 <= size <= len(words) - at:
                        raise InvalidMap(f"is cut short, or has a list of {size} numbers in element {element!r}")
                    at += not kind
                    columns[name].append(float(words[at]) if kind else [int(word) for word in words[at : at + size]])
                    at += size
        except (IndexError, ValueError):
            raise InvalidMap(f"is cut short, or has text among the numbers of element {element!r}") from None
        return columns

    return read


def _binary(content: bytes, header: PlyHeader) -> Callable[[str, int], Columns]:
    """A reader of one element after the other from a binary file; rows of one length are read at once."""
    order, at = ORDERS[header.encoding], header.size

    def take(kind: str, count: int) -> NDArray:
        nonlocal at
        dtype = np.dtype(order + kind)
        if count * dtype.itemsize > len(content) - at:
            raise InvalidMap(f"is cut short: {count:,} numbers announced, {len(content) - at:,} bytes there")
        values = np.frombuffer(content, dtype, count, at)
        at += values.nbytes
        return values

    def row(element: str) -> dict[str, NDArray]:
        values = {}
        for name, kind in header.elements[element][1].items():
            count_kind, item = header.lists.get((element, name), ("", kind))
            values[name] = take(item, _size(take(count_kind, 1)[0]) if count_kind else 1)
        return values

    def read(element: str, count: int) -> Columns:
        nonlocal at
        begin = at
        if not count:
            return {name: [] for name in header.elements[element][1]}
        first = row(element)
        fields = []
        for name, kind in header.elements[element][1].items():
            count_kind, item = header.lists.get((element, name), ("", kind))
            if count_kind:
                fields.append((f"{name} count", order + count_kind))
            fields.append((name, order + item, (len(first[name]),)))
        dtype = np.dtype(fields)
        if count * dtype.itemsize <= len(content) - begin:
            table = np.frombuffer(content, dtype, count, begin)
            if all((table[f"{name} count"] == len(first[name])).all() for (e, name) in header.lists if e == element):
                at = begin + table.nbytes
                return {n: table[n] if (element, n) in header.lists else table[n][:, 0] for n in first}
        at = begin
        rows = [row(element) for _ in range(count)]
        return {n: [r[n].tolist() if (element, n) in header.lists else r[n][0] for r in rows] for n in first}

    return read


def _size(value: np.generic) -> int:
    size = int(value)
    if not 0 <= size <= 10_000:
        raise InvalidMap(f"has a list of {size} numbers: 0 to 10,000 are read")
    return size
