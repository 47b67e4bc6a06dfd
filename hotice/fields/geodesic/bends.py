"""Last bend of a shortest path, in compiled code, as a row of 11 numbers: b (3), o (3), e (3), L, d.

The path comes from a point o, d from the goal, over edges that all run along the unit vector e and bends last at b, L
from o when measured across e. Such a path unfolds to a straight line (Keller's law: it crosses all edges at one angle),
so a point x that lies r from the last edge is d + hypot(L + r, (x - o).e) from the goal, and the bend slides along the
edge to suit x. The goal itself, and any bend without an edge, is a row with e = 0, L = 0 and o = b. Behind a wall that
curves both ways, such as a ball, paths converge: there o is the focus ahead, L < 0, and the root has a minus sign.
"""

from __future__ import annotations

import math

from hotice.compiled import compiled
from hotice.fields.solids import distance_within, normal_within

WIDTH = 11
_LEAST_TURN_PER_M = 0.05
"""Sine of the angle between the normals on both sides of a bend over h, below which it counts as no edge [1/m]."""
_LIFT_PER_M = 1.25
"""Largest distance of a sliding bend from the wall, over h^2 [1/m]."""


@compiled(inline="always", error_model="numpy")
def distance(a, b):
    """|a - b| of two triples."""
    return math.sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2)


@compiled(inline="always", error_model="numpy")
def source(p, d):
    """The row of a point that lies d from the goal."""
    return (p[0], p[1], p[2], p[0], p[1], p[2], 0.0, 0.0, 0.0, 0.0, d)


@compiled(nogil=True, error_model="numpy")
def reach(row, x):
    """(value, b): length of the path over the bend to x, and where it bends for x."""
    rx, ry, rz = x[0] - row[0], x[1] - row[1], x[2] - row[2]
    ex, ey, ez = row[6], row[7], row[8]
    # From the bend to x, split into the part along the edge and the part r across it.
    along = rx * ex + ry * ey + rz * ez
    rx, ry, rz = rx - along * ex, ry - along * ey, rz - along * ez
    r = math.sqrt(rx * rx + ry * ry + rz * rz)
    t = (x[0] - row[3]) * ex + (x[1] - row[4]) * ey + (x[2] - row[5]) * ez
    # Both sides of the edge unfolded into one plane: from o to x it is `flat` across the edge and t along it. The
    # straight line crosses the edge r before its end, so t r / flat of t lie beyond the bend.
    flat = row[9] + r
    shift = along - (t * r / flat if flat != 0.0 else 0.0)
    # Before a focus `flat` is negative, and so is the way from it.
    way = math.copysign(math.sqrt(flat * flat + t * t), flat)
    return row[10] + way, (row[0] + shift * ex, row[1] + shift * ey, row[2] + shift * ez)


@compiled(inline="always", error_model="numpy")
def moved(row, b):
    """The row with its bend at another point of the edge."""
    return (b[0], b[1], b[2], row[3], row[4], row[5], row[6], row[7], row[8], row[9], row[10])


@compiled(nogil=True, error_model="numpy")
def on_edge(space, margin, row, b):
    """Whether the bend may slide to b: it lies on the inflated obstacles still."""
    if row[9] == 0.0:
        return True
    return abs(distance_within(space, b[0], b[1], b[2]) - margin) < _LIFT_PER_M * space.h * space.h


@compiled(nogil=True, error_model="numpy")
def extend(space, margin, row, b, x):
    """The row of a path that bends at row's bend, then at b, and goes on towards x.

    Sideways the wave about the path has the radius of its whole way across edges that are parallel, of the way from the
    last bend across one at a right angle (Euler's formula in between). Walls that curve both ways focus it.
    """
    value, a = reach(row, b)
    ex, ey, ez = _edge(space, a, b, x)
    if ex == 0.0 and ey == 0.0 and ez == 0.0:
        return source(b, value)
    last = max(distance(a, b), 1e-9)
    whole = value - row[10]
    if row[9] != 0.0:
        whole = _focused(space, a, b, (row[6], row[7], row[8]), whole, last)
    whole = math.copysign(max(abs(whole), 1e-9), whole)
    # Curvatures add, not radii: cos² of the angle between the edges weighs the one, sin² the other.
    aligned = (ex * row[6] + ey * row[7] + ez * row[8]) ** 2
    bent = aligned / whole + (1.0 - aligned) / last
    radius = 1.0 / math.copysign(max(abs(bent), 1e-3), bent)
    # o is put `radius` before b against the direction in which the path arrives, so that `reach` at b gives `value`.
    cosine = ((b[0] - a[0]) * ex + (b[1] - a[1]) * ey + (b[2] - a[2]) * ez) / last
    t = radius * cosine
    flat = radius * math.sqrt(max(1.0 - cosine * cosine, 0.0))
    return (b[0], b[1], b[2], b[0] - t * ex, b[1] - t * ey, b[2] - t * ez, ex, ey, ez, flat, value - radius)


@compiled(nogil=True, error_model="numpy")
def _focused(space, a, b, e, radius, way):
    """Radius sideways, along e, of a wave that creeps `way` along the wall from a to b; `radius` if the wall is flat.

    Half of the turn on the way focuses the wave at either end (Jacobi's equation for the distance of near geodesics).
    """
    f = 0.1 * space.h
    p = normal_within(space, a[0], a[1], a[2])
    q = normal_within(space, b[0], b[1], b[2])
    turn = math.acos(min(max(p[0] * q[0] + p[1] * q[1] + p[2] * q[2], -1.0), 1.0))
    # Curvature of the wall across the path: change of its normal along e, by central differences.
    u = normal_within(space, b[0] + f * e[0], b[1] + f * e[1], b[2] + f * e[2])
    v = normal_within(space, b[0] - f * e[0], b[1] - f * e[1], b[2] - f * e[2])
    curved = ((u[0] - v[0]) * e[0] + (u[1] - v[1]) * e[1] + (u[2] - v[2]) * e[2]) / (2.0 * f)
    kick = 0.5 * turn * curved
    # A thin lens, a free way, a thin lens: each turns the wave by its curvature times the width.
    wide, slope = radius - way, 1.0
    slope -= kick * wide
    wide += way * slope
    slope -= kick * wide
    return wide / (slope if slope != 0.0 else 1e-9)


@compiled(nogil=True, error_model="numpy")
def _edge(space, a, b, x):
    """Unit vector along the edge on which the string a-b-x bends, 0 where the wall is flat.

    Normals about an edge are at right angles to it. One is taken on the convex side of the bend, the other towards a
    or, where that differs twice as much, x: on walls that curve both ways the edge is at right angles to the way from
    a.
    """
    # u leads into the bend and v out of it; v - u points into the wall, so w points out of it.
    u, v = _towards(a, b), _towards(b, x)
    w = _towards(v, u)
    k = _normal(space, b, _normal(space, b, w))
    least, edge = _LEAST_TURN_PER_M * space.h, (0.0, 0.0, 0.0)
    for side in range(2):
        n = _normal(space, b, v if side else (-u[0], -u[1], -u[2]))
        ex, ey, ez = k[1] * n[2] - k[2] * n[1], k[2] * n[0] - k[0] * n[2], k[0] * n[1] - k[1] * n[0]
        turn = math.sqrt(ex * ex + ey * ey + ez * ez)
        if turn > least:
            # The side of x has to be twice as clear as that of a.
            least, edge = 2.0 * turn, (ex / turn, ey / turn, ez / turn)
    return edge


@compiled(inline="always", error_model="numpy")
def _towards(a, b):
    """Unit vector from a to b."""
    x, y, z = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    size = max(math.sqrt(x * x + y * y + z * z), 1e-12)
    return x / size, y / size, z / size


@compiled(nogil=True, error_model="numpy")
def _normal(space, b, u):
    """Normal at a tenth of a cell from b along u."""
    f = 0.1 * space.h
    return normal_within(space, b[0] + f * u[0], b[1] + f * u[1], b[2] + f * u[2])
