"""Searches of paths that marches made, kept for later ones in which only some obstacles are elsewhere.

The path of a node follows from the paths of its known neighbours and from the obstacles that the search looked at. Each
search is kept with a code of all that it began from, and with the box of all points that it asked about. A later march
that comes to the same node with the same code, while no obstacle in that box has changed, takes what was found: the
fields are those of a march from nothing, bit for bit, in less time. Codes have 64 bits; that two differing searches of
one node have the same is as likely as 1 in 10^19.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hotice.compiled import compiled
from hotice.fields.geodesic.bends import WIDTH

_MIX, _SHIFT = np.uint64(0x9E3779B97F4A7C15), np.uint64(29)
FORGOTTEN, _BEGIN = np.uint64(0), np.uint64(1)
"""The code of a search that is not to be found again; where codes begin."""
BOX = 1 + WIDTH
KEPT = BOX + 6
_ROOM = 4096


class Searches(NamedTuple):
    """Searches of a grid's nodes, `count[0]` of them in arrays with room for N.

    `first` (size,): a node's newest search, -1 for none; `code` (N,): of what it began from; `link` (N, 2): the search
    of the same node before, and by which side the path leads (`fast_marching.py`); `found` (N, 18): value [m], row of
    the bend, least and largest coordinates that were asked about [m]. `seen` (size,): nodes that see `goal` (3,) [m],
    nothing before the first march. Marches write into these arrays, and replace those that are too small.
    """

    first: NDArray[np.int32]
    code: NDArray[np.uint64]
    link: NDArray[np.int32]
    found: NDArray[np.float64]
    count: NDArray[np.int64]
    seen: NDArray[np.bool_]
    goal: NDArray[np.float64]


def no_searches(size: int = 0) -> Searches:
    """None yet of so many nodes; of no nodes: a march keeps nothing."""
    room = _ROOM if size else 0
    return Searches(
        np.full(size, -1, np.int32),
        np.empty(room, np.uint64),
        np.empty((room, 2), np.int32),
        np.empty((room, KEPT)),
        np.zeros(1, np.int64),
        np.empty(0, np.bool_),
        np.full(3, np.nan),
    )


@compiled(nogil=True)
def forget(searches, changed):
    """Searches that asked about one of the boxes `changed` (M, 6) are not found again."""
    for at in range(searches.count[0]):
        for m in range(len(changed)):
            apart = False
            for i in range(3):
                least, most = searches.found[at, BOX + i], searches.found[at, BOX + 3 + i]
                apart = apart or least > changed[m, 3 + i] or most < changed[m, i]
            if not apart:
                searches.code[at] = FORGOTTEN


@compiled(inline="always")
def recall(first, code, link, node, wanted):
    """The search of a node that began from what `wanted` is the code of; -1: none."""
    at = first[node]
    while at >= 0 and code[at] != wanted:
        at = link[at, 0]
    return at


@compiled(inline="always")
def mix(code, number):
    """Code of all that `code` stands for and of another number, both uint64; never `FORGOTTEN`."""
    code = (code ^ number) * _MIX
    return (code ^ (code >> _SHIFT)) | _BEGIN


@compiled(nogil=True)
def code_of(bits, n):
    """Code of row n of the bit patterns `bits` (N, M) uint64."""
    code = _BEGIN
    for i in range(bits.shape[1]):
        code = mix(code, bits[n, i])
    return code


@compiled(inline="always")
def touch(box, x, y, z):
    """Widens a box (6,) to hold a point."""
    box[0], box[1], box[2] = min(box[0], x), min(box[1], y), min(box[2], z)
    box[3], box[4], box[5] = max(box[3], x), max(box[4], y), max(box[5], z)
