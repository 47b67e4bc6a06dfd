"""Clearance of straight segments from a triangle mesh, in compiled code: of whole segments, not of their points.

A segment that meets no triangle is as far from the mesh as the nearest triangle. Where it meets some, or starts on one,
its depth is looked at between the places where it passes through the surface.
"""

from __future__ import annotations

import math

import numpy as np

from hotice.compiled import compiled
from hotice.fields.solids import mesh_distance, mesh_normal, seen, turned
from hotice.model.geometry.bvh import triangle_squared

_MOST = 64
"""A segment that passes through more triangles than this is blocked."""
OPPOSED = -0.2
"""Largest cosine between the normals of two walls that close a seam or bound a plate."""
_INNER = 7
"""Points of a part below the surface at which its depth is looked at."""


@compiled(inline="always", error_model="numpy")
def _cross(a, b):
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@compiled(inline="always", error_model="numpy")
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@compiled(inline="always", error_model="numpy")
def _minus(a, b):
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@compiled(inline="always", error_model="numpy")
def _corner(triangles, t, i):
    return triangles[t, i, 0], triangles[t, i, 1], triangles[t, i, 2]


@compiled(nogil=True, error_model="numpy")
def _nears_box(nodes, n, a, d, reach):
    """Whether segment a + f d, 0 <= f <= 1, comes into box n grown by `reach`."""
    # Slabs: the part of the segment that lies between each pair of faces; the box is missed when nothing is left.
    low, high = 0.0, 1.0
    for i in range(3):
        least, most = nodes[n, i] - reach - a[i], nodes[n, 3 + i] + reach - a[i]
        if abs(d[i]) < 1e-12:
            if least > 0.0 or most < 0.0:
                return False
            continue
        f, g = least / d[i], most / d[i]
        low, high = max(low, min(f, g)), min(high, max(f, g))
        if low > high:
            return False
    return True


@compiled(nogil=True, error_model="numpy")
def _to_edge(a, d, p, e):
    """(squared distance, f): of segment a + f d to segment p + g e, 0 <= f, g <= 1 (Ericson 2005, 5.1.9)."""
    r = _minus(a, p)
    dd, ee, er = _dot(d, d), _dot(e, e), _dot(e, r)
    dr, de = _dot(d, r), _dot(d, e)
    if ee <= 0.0:
        f = min(max(-dr / dd, 0.0), 1.0) if dd > 0.0 else 0.0
        g = 0.0
    else:
        det = dd * ee - de * de
        f = min(max((de * er - dr * ee) / det, 0.0), 1.0) if det > 1e-14 * dd * ee else 0.0
        g = (de * f + er) / ee
        if g < 0.0 or g > 1.0:
            g = min(max(g, 0.0), 1.0)
            f = min(max((de * g - dr) / dd, 0.0), 1.0) if dd > 0.0 else 0.0
    x, y, z = r[0] + f * d[0] - g * e[0], r[1] + f * d[1] - g * e[1], r[2] + f * d[2] - g * e[2]
    return x * x + y * y + z * z, f


@compiled(nogil=True, error_model="numpy")
def _to_triangle(triangles, t, a, d, b):
    """(squared distance, f, through) of segment a + f d, which ends at b, to triangle t; 0 if it passes `through`."""
    p, q, r = _corner(triangles, t, 0), _corner(triangles, t, 1), _corner(triangles, t, 2)
    u, v, w = _minus(q, p), _minus(r, p), _minus(a, p)
    n = _cross(u, v)
    along, away = _dot(n, d), _dot(n, w)
    # The ends lie on different sides of the plane: g, k and nn - g - k are the crossing's barycentric coordinates,
    # times nn.
    if (away > 0.0) != (away + along > 0.0):
        f = -away / along
        s = (w[0] + f * d[0], w[1] + f * d[1], w[2] + f * d[2])
        nn = _dot(n, n)
        g, k = _dot(n, _cross(s, v)), _dot(n, _cross(u, s))
        if nn > 0.0 and g >= 0.0 and k >= 0.0 and g + k <= nn:
            return 0.0, f, True
    # No crossing: the least distance is at an end of the segment or at an edge of the triangle.
    best, at = triangle_squared(triangles, t, a[0], a[1], a[2]), 0.0
    end = triangle_squared(triangles, t, b[0], b[1], b[2])
    if end < best:
        best, at = end, 1.0
    for side in range(3):
        p, e = (p, u) if side == 0 else (q, _minus(r, q)) if side == 1 else (r, _minus(p, r))
        far, f = _to_edge(a, d, p, e)
        if far < best:
            best, at = far, f
        p = _corner(triangles, t, 0)
    return best, at, False


@compiled(nogil=True, error_model="numpy")
def _off_centre(nodes, n, a, d, dd):
    """Squared distance of segment a + f d to the centre of box n."""
    x = 0.5 * (nodes[n, 0] + nodes[n, 3]) - a[0]
    y = 0.5 * (nodes[n, 1] + nodes[n, 4]) - a[1]
    z = 0.5 * (nodes[n, 2] + nodes[n, 5]) - a[2]
    f = min(max((x * d[0] + y * d[1] + z * d[2]) / dd, 0.0), 1.0)
    x, y, z = x - f * d[0], y - f * d[1], z - f * d[2]
    return x * x + y * y + z * z


@compiled(nogil=True, error_model="numpy")
def approach(triangles, nodes, root, a, b, bound, enough, passed):
    """(distance, f, number): how near segment a-b, in the mesh's frame, comes to the mesh at `root`, and where.

    The distance is 0 where it passes through triangles; `passed` (MOST + 1, 4) then holds where (sorted) and their unit
    normals. Without any nearer than `bound`, that and f = 0; number = -1 when there are more than fit. Ends early, with
    what is known so far, once the distance is under `enough`.
    """
    d = _minus(b, a)
    dd = max(_dot(d, d), 1e-300)
    best, at, number = bound * bound, 0.0, 0
    reach = bound
    stack = np.empty(64, np.int64)
    stack[0] = root
    top = 1
    while top > 0:
        top -= 1
        node = stack[top]
        if not _nears_box(nodes, node, a, d, reach):
            continue
        first, count = int(nodes[node, 6]), int(nodes[node, 7])
        if count == 0:
            # An inner node: its first child follows it. The nearer one is put on top of the stack, so that the bound
            # shrinks early.
            near, far = node + 1, first
            if _off_centre(nodes, near, a, d, dd) > _off_centre(nodes, far, a, d, dd):
                near, far = far, near
            stack[top], stack[top + 1] = far, near
            top += 2
            continue
        for t in range(first, first + count):
            far, f, through = _to_triangle(triangles, t, a, d, b)
            if far < best:
                best, at = far, f
                reach = math.sqrt(best)
                if reach < enough:
                    return reach, at, number
            if through:
                if number == _MOST:
                    return 0.0, at, -1
                p, q, r = _corner(triangles, t, 0), _corner(triangles, t, 1), _corner(triangles, t, 2)
                n = _cross(_minus(q, p), _minus(r, p))
                size = math.sqrt(_dot(n, n))
                i = number
                # Sorted by insertion: hits are few, and the order in which triangles come is arbitrary.
                while i > 0 and passed[i - 1, 0] > f:
                    passed[i] = passed[i - 1]
                    i -= 1
                passed[i, 0], passed[i, 1], passed[i, 2], passed[i, 3] = f, n[0] / size, n[1] / size, n[2] / size
                number += 1
    return math.sqrt(best), at, number


@compiled(nogil=True, error_model="numpy")
def pass_mesh(space, margin, n, a, b, depth, exact):
    """(free, t, s) of segment a-b beside mesh n, inflated by `margin`: its lowest clearance s, t from a.

    Unless `exact`, t and s of a segment that is not free are those of the first place found that blocks it.

    It is free when it cuts the mesh by less than `depth` and neither bores through a plate nor squeezes between two
    walls. s is infinite when it stays `depth` and more away.
    """
    solid = space.solid
    u = _minus(b, a)
    length = math.sqrt(_dot(u, u))
    passed = np.empty((_MOST + 1, 4))
    p, q = seen(solid, n, a[0], a[1], a[2]), seen(solid, n, b[0], b[1], b[2])
    enough = 0.0 if exact else margin - depth
    near, f, number = approach(space.triangles, space.nodes, int(solid[n, 20]), p, q, margin + depth, enough, passed)
    if near >= margin + depth:
        return True, 0.0, math.inf
    # On the surface itself a segment is as deep as the margin.
    if number < 0 or (number > 0 and margin > depth):
        return False, f * length, -margin
    s = near - margin
    if number > 0 or near < depth:
        free, g, low = _below(space, n, a, u, passed, number, margin - depth)
        if not free:
            return False, g * length, low - margin
        if low < 0.0:
            f, s = g, low - margin
    if s < -depth:
        return False, f * length, s
    x, y, z = a[0] + f * u[0], a[1] + f * u[1], a[2] + f * u[2]
    # A step out to `2 depth` from this wall must have more than `depth` of room, or another wall faces it.
    out = mesh_normal(space, n, x, y, z, s + margin)
    away = 2.0 * depth - s
    beyond = mesh_distance(space, n, x + away * out[0], y + away * out[1], z + away * out[2]) - margin
    return beyond > depth, f * length, s


@compiled(nogil=True, error_model="numpy")
def stays_off(space, n, a, b, bound):
    """Whether segment a-b stays `bound` away from mesh n."""
    solid = space.solid
    passed = np.empty((_MOST + 1, 4))
    p, q = seen(solid, n, a[0], a[1], a[2]), seen(solid, n, b[0], b[1], b[2])
    return approach(space.triangles, space.nodes, int(solid[n, 20]), p, q, bound, bound, passed)[0] >= bound


@compiled(nogil=True, error_model="numpy")
def _below(space, n, a, u, passed, number, lowest):
    """(free, f, s): the deepest place a + f u of the parts of a segment below the surface of mesh n, s = 0 without any.

    Not free where that is below `lowest` or where the walls at both ends of a part face away from each other.
    """
    at, deepest = 0.0, 0.0
    for i in range(number + 1):
        low = passed[i - 1, 0] if i > 0 else 0.0
        high = passed[i, 0] if i < number else 1.0
        for k in range(_INNER):
            # The middle first: it tells whether this part lies below the surface at all.
            f = low + (high - low) * (0.5 if k == 0 else k / _INNER)
            s = _signed(space, n, a, u, f)
            if k == 0 and s >= 0.0:
                break
            if s < lowest:
                return False, f, s
            if s < deepest:
                at, deepest = f, s
            if k == 0:
                v = _wall(space, n, a, u, passed, i - 1, number)
                w = _wall(space, n, a, u, passed, i, number)
                if _dot(v, w) < OPPOSED:
                    return False, f, s
    return True, at, deepest


@compiled(nogil=True, error_model="numpy")
def _wall(space, n, a, u, passed, i, number):
    """Normal of the wall of mesh n in which part i of a segment a + f u ends; at an end of the segment, the nearest."""
    if 0 <= i < number:
        return passed[i, 1], passed[i, 2], passed[i, 3]
    f = 0.0 if i < 0 else 1.0
    x, y, z = a[0] + f * u[0], a[1] + f * u[1], a[2] + f * u[2]
    w = mesh_normal(space, n, x, y, z, mesh_distance(space, n, x, y, z))
    return turned(space.solid, n, w[0], w[1], w[2])


@compiled(inline="always", error_model="numpy")
def _signed(space, n, a, u, f):
    return mesh_distance(space, n, a[0] + f * u[0], a[1] + f * u[1], a[2] + f * u[2])
