"""Occupancy octrees of OctoMap, binary form (`.bt`): the cells that are known to be occupied, as points.

A header of text ends in a line `data`; then one inner node after another, depth first. Of a node's eight children each
has two bits, the first child the lowest: 00 unknown, 01 free, 10 occupied, 11 an inner node that follows. Child number:
1 for the upper half in x, 2 in y, 4 in z. The root's cube is 2^16 finest cells wide and centred on the origin.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from hotice.compiled import compiled
from hotice.errors import InvalidMap
from hotice.model.importers.formats.records import MAX_HEADER_BYTES, check_count, count_of

FIRST_LINE = b"# Octomap OcTree binary file"
DEPTH = 16
MIDDLE = 1 << DEPTH - 1
COMPLETE, CUT, TOO_DEEP = range(3)


def read_octomap(content: bytes, spacing: float) -> tuple[NDArray[np.float64], float]:
    """Points in the occupied cells, (n, 3), at most `spacing` apart along each axis, and the finest cells' edge.

    All in the file's unit. Free and unknown cells give none. Raises `InvalidMap`.
    """
    resolution, nodes, data = _header(content)
    cells, read = _cells(data)
    if read != nodes:
        raise InvalidMap(f"OctoMap header says {nodes:,} nodes, the tree has {read:,}: the file is damaged")
    per_cell = math.ceil(resolution / spacing - 1e-9)
    check_count(int(((cells[:, 3].astype(np.float64) * per_cell) ** 3).sum()))
    parts = []
    for size in np.unique(cells[:, 3]):
        low = cells[cells[:, 3] == size, :3] - MIDDLE
        along = (np.arange(size * per_cell) + 0.5) / per_cell
        within = np.stack(np.meshgrid(along, along, along, indexing="ij"), axis=-1).reshape(-1, 3)
        parts.append((resolution * (low[:, None] + within)).reshape(-1, 3))
    return (np.concatenate(parts) if parts else np.zeros((0, 3))), resolution


def _header(content: bytes) -> tuple[float, int, bytes]:
    """Edge of the finest cells, number of nodes, and the tree's bytes."""
    if not content.startswith(FIRST_LINE):
        raise InvalidMap(
            f"is not a binary OctoMap: its first line is not {FIRST_LINE.decode()!r} (.ot files and those of before "
            "2011 are not read: convert them with `convert_octree`)"
        )
    end = content.find(b"\ndata\n", 0, MAX_HEADER_BYTES)
    if end < 0:
        raise InvalidMap("OctoMap header has no line `data`")
    lines = (line.split() for line in content[:end].decode("ascii", "replace").splitlines() if line[:1] != "#")
    entries = {words[0]: words[1] for words in lines if len(words) == 2}
    missing = [key for key in ("id", "size", "res") if key not in entries]
    if missing:
        raise InvalidMap(f"OctoMap header has no {' and no '.join(missing)}")
    if entries["id"] != "OcTree":
        raise InvalidMap(f"OctoMap tree is of type {entries['id'][:40]!r}: OcTree is read; convert it")
    try:
        resolution = float(entries["res"])
    except ValueError:
        resolution = math.nan
    if not 1e-6 <= resolution <= 1e6:
        raise InvalidMap(f"OctoMap resolution is {entries['res'][:40]!r}: a number between 1e-06 and 1e+06 is needed")
    return resolution, count_of("OctoMap size", entries["size"]), content[end + len(b"\ndata\n") :]


def _cells(data: bytes) -> tuple[NDArray[np.int64], int]:
    """Occupied leaves, rows of lowest corner and edge in finest cells (n, 4), and the number of nodes of the tree."""
    if not data:
        return np.zeros((0, 4), np.int64), 0
    words = np.frombuffer(data[: len(data) // 2 * 2], dtype="<u2")
    codes = words[:, None] >> np.arange(0, 16, 2, dtype=np.uint16) & 3
    cells = np.empty((np.count_nonzero(codes == 2), 4), dtype=np.int64)
    found, nodes, status = _walk(codes, cells)
    if status == CUT:
        raise InvalidMap("is cut short: the tree of the OctoMap goes on beyond the file's end")
    if status == TOO_DEEP:
        raise InvalidMap(f"OctoMap tree is deeper than {DEPTH} levels: the file is damaged")
    return cells[:found], nodes


@compiled
def _walk(codes, cells):
    """Number of occupied leaves written to `cells` (n, 4), number of nodes, and how it ended; codes (m, 8)."""
    corner = np.zeros((DEPTH + 1, 3), dtype=np.int64)
    row = np.zeros(DEPTH + 1, dtype=np.int64)
    child = np.zeros(DEPTH + 1, dtype=np.int64)
    used, found, nodes, level = 1, 0, 1, 0
    if len(codes) == 0:
        return found, nodes, CUT
    while level >= 0:
        i = child[level]
        if i == 8:
            level -= 1
            continue
        child[level] += 1
        code = codes[row[level], i]
        if code == 0:
            continue
        nodes += 1
        edge = 1 << (DEPTH - level - 1)
        x = corner[level, 0] + (i & 1) * edge
        y = corner[level, 1] + (i >> 1 & 1) * edge
        z = corner[level, 2] + (i >> 2) * edge
        if code == 2:
            cells[found, 0], cells[found, 1], cells[found, 2], cells[found, 3] = x, y, z, edge
            found += 1
        elif code == 3:
            if level + 1 == DEPTH:
                return found, nodes, TOO_DEEP
            if used == len(codes):
                return found, nodes, CUT
            level += 1
            corner[level, 0], corner[level, 1], corner[level, 2] = x, y, z
            row[level], child[level] = used, 0
            used += 1
    return found, nodes, COMPLETE
