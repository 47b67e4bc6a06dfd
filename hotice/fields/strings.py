"""Taut strings past obstacles in compiled code: is a segment free, and where does a string bend that is not.

Segments are traced by spheres on the exact signed distance; far from obstacles the grid's values serve as bounds. A
segment may cut a wall by less than `DEPTH_PER_M h^2`, so that strings creep along curved walls in finite steps whose
error falls with h^2; it may not leave by a side that faces the other way, so plates stay closed however thin.
"""

from __future__ import annotations

import math

from hotice.compiled import compiled
from hotice.fields.bends import extend, moved, on_edge, reach
from hotice.fields.solids import distance_bound, distance_within, normal_within

DEPTH_PER_M = 0.25
STEP_PER_M = 1.0
"""Least step of a trace over h^2 [1/m]."""
_LONGEST = 0.25
"""Longest step in cells along a wall that stays level within this slope:"""
_LEVEL = 0.02
_NEAR = 0.3
"""Bounds below this many cells are replaced by exact distances."""
_TURN = -0.2
"""Least cosine between the normals at the ends of a step in touch with a wall."""
_MAX_STEPS = 1000
_HALVINGS = 7
_MAX_BENDS = 12


@compiled(inline="always", error_model="numpy")
def distance(a, b):
    """|a - b| of two triples."""
    return math.sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2)


@compiled(nogil=True, error_model="numpy")
def trace(space, margin, a, b):
    """(free, at, s) of the segment a-b among obstacles inflated by `margin`.

    `at`: distance from a to the lowest clearance s that it comes down to, s = inf when it never nears a wall.
    """
    ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    length = max(math.sqrt(ux * ux + uy * uy + uz * uz), 1e-12)
    ux, uy, uz = ux / length, uy / length, uz / length
    sdf, h = space.sdf, space.h
    ox, oy, oz, nx, ny, nz = space.ox, space.oy, space.oz, space.nx, space.ny, space.nz
    least, near, deepest = STEP_PER_M * h * h, _NEAR * h, -DEPTH_PER_M * h * h
    t, at, lowest, last = 0.0, 0.0, math.inf, -math.inf
    stride, longest = least, _LONGEST * h
    thin = space.thinnest + 2.0 * margin < 2.0 * longest
    touching, known, away = False, 0.0, math.inf
    before = (0.0, 0.0, 0.0)
    for _ in range(_MAX_STEPS):
        x, y, z = a[0] + t * ux, a[1] + t * uy, a[2] + t * uz
        s = distance_bound(sdf, ox, oy, oz, h, nx, ny, nz, x, y, z) - margin
        if s < near:
            s = distance_within(space, x, y, z, known, away) - margin
            known = s + margin
            if s < min(lowest, last):
                lowest, at = s, t
            level = touching and abs(s - last) < _LEVEL * stride
            stride = min(2.0 * stride, longest) if level else least
            last = s
            if s < deepest:
                return False, at, lowest
            if thin and (touching or s < least):
                n = normal_within(space, x, y, z, s + margin)
                if touching and n[0] * before[0] + n[1] * before[1] + n[2] * before[2] < _TURN:
                    return False, at, lowest
                before = n
            touching = s < least
        else:
            touching, last, stride = False, math.inf, least
            known = 0.0
        if t >= length:
            return True, at, lowest
        step = min(max(abs(s), stride), length - t)
        away = step if known != 0.0 else math.inf
        t = min(t + step, length)
    return False, at, lowest


@compiled(nogil=True, error_model="numpy")
def graze(space, margin, a, y, x):
    """(found, b): where the string from a to the last point of y-x that a sees touches the wall; a sees y, not x."""
    low, high = 0.0, 1.0
    at, s = 0.0, math.inf
    end = y
    for step in range(_HALVINGS + 1):
        f = 0.5 * (low + high)
        if step == _HALVINGS:
            if low > 0.0:
                break
            f = 0.0
        q = (y[0] + f * (x[0] - y[0]), y[1] + f * (x[1] - y[1]), y[2] + f * (x[2] - y[2]))
        free, t, clearance = trace(space, margin, a, q)
        if free:
            at, s, end, low = t, clearance, q, f
        else:
            high = f
    length = distance(a, end)
    if s == math.inf or length == 0.0:
        return False, a
    f = at / length
    px, py, pz = a[0] + f * (end[0] - a[0]), a[1] + f * (end[1] - a[1]), a[2] + f * (end[2] - a[2])
    nx, ny, nz = normal_within(space, px, py, pz, s + margin)
    return True, (px - s * nx, py - s * ny, pz - s * nz)


@compiled(nogil=True, error_model="numpy")
def join(space, margin, row, x, best):
    """(value, row) of the path over the bend of `row` straight to x: inf when a wall hides it or best is shorter."""
    value, b = reach(row, x)
    if value >= best:
        return math.inf, row
    if on_edge(space, margin, row, b) and trace(space, margin, b, x)[0]:
        return value, moved(row, b)
    return math.inf, row


@compiled(nogil=True, error_model="numpy")
def pull(space, margin, row, y, x, best):
    """(value, row) of the string over the bend of `row`, which y sees, past further bends near y-x to x.

    The value is inf when none shorter than `best` is found.
    """
    for _ in range(_MAX_BENDS):
        found, b = graze(space, margin, (row[0], row[1], row[2]), y, x)
        if not found:
            break
        row = extend(space, margin, row, b, x)
        if reach(row, x)[0] >= best:
            break
        value, slid = join(space, margin, row, x, best)
        if value < math.inf:
            return value, slid
    return math.inf, row
