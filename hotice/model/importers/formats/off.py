"""Object File Format (text): vertices and the triangles of its faces; normals and colours are left out."""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import NDArray

from hotice.errors import InvalidMap
from hotice.model.importers.formats.records import check_count, count_of
from hotice.model.importers.polygons import BadPolygon, fill

_HEADER = re.compile(rb"(ST)?C?N?OFF")


def read_off(content: bytes) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Vertices (V, 3) [the file's unit], which may be not finite, and triangles (F, 3). Raises `InvalidMap`."""
    lines = [line for line in (text.partition(b"#")[0].split() for text in content.splitlines()) if line]
    if not lines or not _HEADER.fullmatch(lines[0][0]) or lines[0][1:2] == [b"BINARY"]:
        raise InvalidMap("is not a text OFF file: it does not begin with OFF, COFF, NOFF or STOFF")
    lines[0] = lines[0][1:]
    lines = lines if lines[0] else lines[1:]
    if not lines or len(lines[0]) < 2:
        raise InvalidMap("OFF header lacks its numbers of vertices and faces")
    vertex_count, face_count = (count_of("OFF count", word.decode("ascii", "replace")) for word in lines[0][:2])
    check_count(vertex_count)
    if len(lines) < 1 + vertex_count + face_count:
        raise InvalidMap(
            f"is cut short: {vertex_count:,} vertices and {face_count:,} faces announced, "
            f"{len(lines) - 1:,} lines there"
        )
    try:
        rows = [line[:3] for line in lines[1 : 1 + vertex_count]]
        vertices = np.array(rows, dtype=np.bytes_).astype(np.float64).reshape(-1, 3)
        faces = [list(map(int, line)) for line in (_face(line) for line in lines[1 + vertex_count :][:face_count])]
        return vertices, fill(vertices, faces)
    except BadPolygon as bad:
        raise InvalidMap(f"face {bad.number + 1} {bad}") from None
    except ValueError:
        raise InvalidMap("has a vertex or face that holds something else than numbers") from None


def _face(words: list[bytes]) -> list[bytes]:
    count = int(words[0])
    if not 0 <= count < len(words):
        raise InvalidMap(f"has a face of {count} corners with {len(words) - 1} numbers after it")
    return words[1 : 1 + count]
