"""Wavefront OBJ: vertices and the triangles of its faces; materials, lines and curves are left out."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hotice.errors import InvalidMap
from hotice.model.importers.polygons import BadPolygon, fill


def read_obj(content: bytes) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Vertices (V, 3) [the file's unit], which may be not finite, and triangles (F, 3).

    Faces count vertices from 1, or backwards from the last one before them (-1). Raises `InvalidMap` with the line.
    """
    rows: list[list[bytes]] = []
    polygons: list[list[int]] = []
    lines: list[int] = []
    for number, line in _lines(content):
        words = line.split()
        if not words:
            continue
        if words[0] == b"v":
            if len(words) < 4:
                raise InvalidMap(f"line {number}: a vertex needs x, y and z, {len(words) - 1} numbers came")
            rows.append(words[1:4])
        elif words[0] == b"f":
            try:
                face = [int(word.partition(b"/")[0]) - 1 for word in words[1:]]
            except ValueError:  # a comment, or a fault
                face = _face(words[1:], len(rows), number)
            polygons.append(face if min(face, default=0) >= 0 else _face(words[1:], len(rows), number))
            lines.append(number)
    vertices = _numbers(rows)
    try:
        return vertices, fill(vertices, polygons)
    except BadPolygon as bad:
        face = polygons[bad.number]
        if max(face) >= len(vertices):
            raise InvalidMap(
                f"line {lines[bad.number]}: face index {max(face) + 1} is beyond the {len(vertices):,} vertices"
            ) from None
        raise InvalidMap(f"line {lines[bad.number]}: the face {bad}") from None


def _lines(content: bytes):
    """(number, line) of all lines, those that end with a backslash joined to the next."""
    if b"\\" not in content:
        yield from enumerate(content.splitlines(), 1)
        return
    begun, first = b"", 0
    for number, line in enumerate(content.splitlines(), 1):
        if line.endswith(b"\\"):
            begun, first = begun + line[:-1] + b" ", first or number
            continue
        yield (first, begun + line) if first else (number, line)
        begun, first = b"", 0


def _face(words: list[bytes], seen: int, number: int) -> list[int]:
    """Vertex numbers from 0 of a face after `seen` vertices; those beyond the last are found when all are there."""
    face = []
    for word in words:
        if word.startswith(b"#"):
            break
        text = word.partition(b"/")[0]
        try:
            index = int(text)
        except ValueError:
            raise InvalidMap(f"line {number}: {text[:40].decode('ascii', 'replace')!r} is no vertex number") from None
        if index == 0 or index < -seen:
            what = "OBJ counts vertices from 1" if index == 0 else f"only {seen:,} vertices come before it"
            raise InvalidMap(f"line {number}: face index {index}: {what}; export the mesh again")
        face.append(index - 1 if index > 0 else seen + index)
    return face


def _numbers(rows: list[list[bytes]]) -> NDArray[np.float64]:
    try:
        return np.array(rows, dtype=np.bytes_).astype(np.float64).reshape(-1, 3)
    except ValueError as error:
        raise InvalidMap(f"has a vertex that holds something else than numbers: {str(error)[:80]}") from None
