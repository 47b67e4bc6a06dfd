"""Taut strings past obstacles in compiled code: where does a string bend that an obstacle hides."""

from __future__ import annotations

import math

from hotice.compiled import compiled
from hotice.fields.geodesic.bends import extend, moved, on_edge, reach, source
from hotice.fields.geodesic.memory import touch
from hotice.fields.geodesic.segments import blocker, convex_clearance, depth_of, lowest_point
from hotice.fields.solids import MESH

OFF_EDGE = -2
"""Instead of an obstacle: the edge ends before the place where the string would bend."""
_HALVINGS = 7
_MAX_BENDS = 12


@compiled(inline="always", error_model="numpy")
def between(y, x, f):
    """Point y + f (x - y) of two triples."""
    return (y[0] + f * (x[0] - y[0]), y[1] + f * (x[1] - y[1]), y[2] + f * (x[2] - y[2]))


@compiled(nogil=True, error_model="numpy")
def _still_blocks(space, margin, n, a, b):
    """Whether obstacle n blocks segment a-b; False for a mesh, of which nobody asks alone."""
    if space.solid[n, 0] == MESH:
        return False
    deepest = -depth_of(space.solid, n, margin, space.h)
    return convex_clearance(space.solid, n, margin, a, b, deepest, deepest)[0] < deepest


@compiled(nogil=True, error_model="numpy")
def graze(space, margin, a, y, x, n):
    """(found, b): where the string from a to the first point of y-x that a does not see would touch the wall.

    a sees y; obstacle n hides x.
    """
    low, high = 0.0, 1.0
    for _ in range(_HALVINGS):
        # The obstacle that blocked last is asked first, which is far cheaper than asking all.
        f = 0.5 * (low + high)
        q = between(y, x, f)
        if _still_blocks(space, margin, n, a, q):
            high = f
            continue
        other = blocker(space, margin, a, q)
        if other >= 0:
            n, high = other, f
        else:
            low = f
    return lowest_point(space, margin, n, a, between(y, x, high))


@compiled(nogil=True, error_model="numpy")
def join(space, margin, row, x, best, box):
    """(value, obstacle) of the path over the bend of `row` straight to x.

    The value is inf when an obstacle hides the bend, when the edge ends (`OFF_EDGE`), or when `best` is shorter. `box`
    (6,) is widened to hold all points that obstacles are asked about, but for the last few millimetres.
    """
    value, b = reach(row, x)
    if value >= best:
        return math.inf, -1
    touch(box, b[0], b[1], b[2])
    if not on_edge(space, margin, row, b):
        return math.inf, OFF_EDGE
    n = blocker(space, margin, b, x)
    return (value if n < 0 else math.inf), n


@compiled(nogil=True, error_model="numpy")
def pull(space, margin, row, y, x, n, best, box):
    """(value, row) of the string over the bend of `row`, which y sees, past further bends near y-x to x.

    n: what `join` says of row and x. The value is inf when none shorter than `best` is found. `box`: see `join`; it
    holds x and y.
    """
    # The string starts from where the bend lies for y, which sees it.
    row = moved(row, reach(row, y)[1])
    for _ in range(_MAX_BENDS):
        a = (row[0], row[1], row[2])
        touch(box, a[0], a[1], a[2])
        if n == OFF_EDGE:
            n = blocker(space, margin, a, x)
            # Nothing is in the way beyond the end of the edge: the path turns at its last place as about a point.
            if n < 0:
                row = source(a, reach(row, a)[0])
                value, _ = reach(row, x)
                return (value if value < best else math.inf), row
        found, b = graze(space, margin, a, y, x, n)
        if not found:
            break
        touch(box, b[0], b[1], b[2])
        last = reach(row, b)[1]
        touch(box, last[0], last[1], last[2])
        row = extend(space, margin, row, b, x)
        value, n = join(space, margin, row, x, best, box)
        if value < math.inf or n == -1:
            return value, row
    return math.inf, row
