"""Free straight segments between analytic obstacles, in compiled code.

Boxes, cylinders and capsules are convex, so the signed distance to one of them is a convex function along a segment:
its least value follows from a few values and slopes by cutting planes (Kelley 1960), and a segment that leaves one
never meets it again. Meshes: `mesh_segments.py`. Obstacles are inflated by `margin`; a segment may cut one by less than
`DEPTH_PER_M h^2`, so that strings creep along curved walls in finite steps whose error falls with h^2, but it may
neither cross a plate, however thin, nor slip through the seam of two obstacles that touch.
"""

from __future__ import annotations

import math

from hotice.compiled import compiled
from hotice.fields.geodesic.bends import distance
from hotice.fields.geodesic.mesh_segments import OPPOSED, pass_mesh
from hotice.fields.solids import (
    BOX,
    CAPSULE,
    CYLINDER,
    MESH,
    convex_slope,
    mesh_normal,
    seen,
    solid_distance,
    solid_normal,
    turned,
)

DEPTH_PER_M = 0.25
_THIN_SHARE = 0.2
"""Least part of an obstacle's half thickness that a segment may not cut."""
_EXACT_M = 1e-7
_SNAP_M = 1e-5
"""Least distance within which a bend belongs to an edge."""
_CUTS = 40


@compiled(inline="always", error_model="numpy")
def overlap(low, high, start, way, least, most):
    """Part low .. high of a segment narrowed to where start + f way lies between least and most."""
    if abs(way) < 1e-12:
        return (low, high) if least <= start <= most else (1.0, 0.0)
    f, g = (least - start) / way, (most - start) / way
    return max(low, min(f, g)), min(high, max(f, g))


@compiled(nogil=True, error_model="numpy")
def passes_box(solid, nodes, n, a, b, reach):
    """Whether segment a-b comes into the box about obstacle n, grown by `reach`; a lower bound of being near it."""
    ax, ay, az = seen(solid, n, a[0], a[1], a[2])
    ux, uy, uz = turned(solid, n, b[0] - a[0], b[1] - a[1], b[2] - a[2])
    kind = solid[n, 0]
    if kind == MESH:
        root = int(solid[n, 20])
        low, high = overlap(0.0, 1.0, ax, ux, nodes[root, 0] - reach, nodes[root, 3] + reach)
        low, high = overlap(low, high, ay, uy, nodes[root, 1] - reach, nodes[root, 4] + reach)
        low, high = overlap(low, high, az, uz, nodes[root, 2] - reach, nodes[root, 5] + reach)
        return low <= high
    # Half extents. Cylinders and capsules hold a radius and a half length instead, with z as their axis.
    ex, ey, ez = solid[n, 1], solid[n, 2], solid[n, 3]
    if kind == CYLINDER:
        ey, ez = solid[n, 1], solid[n, 2]
    elif kind == CAPSULE:
        ey, ez = solid[n, 1], solid[n, 2] + solid[n, 1]
    low, high = overlap(0.0, 1.0, ax, ux, -ex - reach, ex + reach)
    if low > high:
        return False
    low, high = overlap(low, high, ay, uy, -ey - reach, ey + reach)
    if low > high:
        return False
    low, high = overlap(low, high, az, uz, -ez - reach, ez + reach)
    return low <= high


@compiled(nogil=True, error_model="numpy")
def convex_clearance(solid, n, margin, a, b, below, above):
    """(s, t): least clearance s of convex obstacle n on segment a-b and the distance t from a where it is reached.

    Ends early once s is certainly under `below` or over `above`; s and t are then those of the best point so far.
    """
    ax, ay, az = seen(solid, n, a[0], a[1], a[2])
    ux, uy, uz = turned(solid, n, b[0] - a[0], b[1] - a[1], b[2] - a[2])
    length = math.sqrt(ux * ux + uy * uy + uz * uz)
    size = max(length, 1e-12)
    ux, uy, uz = ux / size, uy / size, uz / size
    low, high = 0.0, length
    f_low, g_low = convex_slope(solid, n, ax, ay, az, ux, uy, uz)
    # The ends settle most cases: a convex function that climbs at a is lowest there, and a distance cannot change
    # faster than the way.
    if g_low >= 0.0 or f_low - margin < below or f_low - length - margin > above:
        return f_low - margin, 0.0
    f_high, g_high = convex_slope(solid, n, ax + length * ux, ay + length * uy, az + length * uz, ux, uy, uz)
    if g_high <= 0.0 or f_high - margin < below:
        return f_high - margin, length
    for _ in range(_CUTS):
        # Where the tangents at both ends meet; the function lies above them, so `least` bounds it from below.
        t = (f_high - f_low + g_low * low - g_high * high) / (g_low - g_high)
        t = min(max(t, low), high)
        least = f_low + g_low * (t - low)
        if least - margin > above or least >= min(f_low, f_high) - _EXACT_M:
            break
        f, g = convex_slope(solid, n, ax + t * ux, ay + t * uy, az + t * uz, ux, uy, uz)
        if f - margin < below:
            return f - margin, t
        if g < 0.0:
            low, f_low, g_low = t, f, g
        else:
            high, f_high, g_high = t, f, g
    return (f_low - margin, low) if f_low < f_high else (f_high - margin, high)


@compiled(inline="always", error_model="numpy")
def depth_of(solid, n, margin, h):
    """Depth to which a segment may cut convex obstacle n [m]."""
    # A plate thinner than the depth that is allowed would be crossed: only a share of its half thickness may be cut.
    thin = min(solid[n, 1], solid[n, 2]) if solid[n, 0] != CAPSULE else solid[n, 1]
    if solid[n, 0] != CYLINDER and solid[n, 0] != CAPSULE:
        thin = min(thin, solid[n, 3])
    return min(DEPTH_PER_M * h * h, _THIN_SHARE * (thin + margin))


@compiled(nogil=True, error_model="numpy")
def blocker(space, margin, a, b):
    """An obstacle that blocks segment a-b, -1 when it is free."""
    solid = space.solid
    touch = DEPTH_PER_M * space.h * space.h
    other, at = -1, 0.0
    for n in range(len(solid)):
        if not passes_box(solid, space.nodes, n, a, b, margin + touch):
            continue
        if solid[n, 0] == MESH:
            if not pass_mesh(space, margin, n, a, b, touch, False)[0]:
                return n
            continue
        deepest = -depth_of(solid, n, margin, space.h)
        s, t = convex_clearance(solid, n, margin, a, b, deepest, touch)
        if s < deepest:
            return n
        if s < touch:
            # Two obstacles that the segment only touches, each from its side, close a seam: nothing passes between
            # them.
            if other >= 0 and (
                _pinched(space, margin, other, n, a, b, t) or _pinched(space, margin, n, other, a, b, at)
            ):
                return n
            other, at = n, t
    return -1


@compiled(nogil=True, error_model="numpy")
def _pinched(space, margin, m, n, a, b, t):
    """Whether obstacle m, too, touches a-b at t from a, where n does, and from the other side."""
    f = t / max(distance(a, b), 1e-12)
    x, y, z = a[0] + f * (b[0] - a[0]), a[1] + f * (b[1] - a[1]), a[2] + f * (b[2] - a[2])
    s = solid_distance(space.solid, space.triangles, space.nodes, m, x, y, z, math.inf, False)
    if s - margin > DEPTH_PER_M * space.h * space.h:
        return False
    u, v = solid_normal(space.solid, m, x, y, z), solid_normal(space.solid, n, x, y, z)
    return u[0] * v[0] + u[1] * v[1] + u[2] * v[2] < OPPOSED


@compiled(nogil=True, error_model="numpy")
def lowest_point(space, margin, n, a, b):
    """(found, p): the point of the inflated obstacle n that segment a-b comes nearest to, or cuts deepest at."""
    if space.solid[n, 0] == MESH:
        _, t, s = pass_mesh(space, margin, n, a, b, DEPTH_PER_M * space.h * space.h, True)
    else:
        s, t = convex_clearance(space.solid, n, margin, a, b, -math.inf, math.inf)
    if s == math.inf:
        return False, a
    f = t / max(distance(a, b), 1e-12)
    x, y, z = a[0] + f * (b[0] - a[0]), a[1] + f * (b[1] - a[1]), a[2] + f * (b[2] - a[2])
    if space.solid[n, 0] == MESH:
        u = mesh_normal(space, n, x, y, z, s + margin)
    else:
        u = solid_normal(space.solid, n, x, y, z)
        # Inflated edges are round; sharp ones are hit exactly, or strings would bend on a face beside them.
        if margin == 0.0:
            return True, _on_edge(space.solid, n, x - s * u[0], y - s * u[1], z - s * u[2], max(-s, _SNAP_M))
    return True, (x - s * u[0], y - s * u[1], z - s * u[2])


@compiled(nogil=True, error_model="numpy")
def _on_edge(solid, n, x, y, z, near):
    """A surface point of convex obstacle n moved onto the edge or rim that lies within `near` of it, if there is one.

    A string that cuts an edge by a little is deepest where both faces are equally near.
    """
    # In the obstacle's frame, where edges are at ± half extents; the result goes back to W.
    x, y, z = seen(solid, n, x, y, z)
    near += _EXACT_M
    if solid[n, 0] == BOX:
        if abs(x) > solid[n, 1] - near:
            x = math.copysign(solid[n, 1], x)
        if abs(y) > solid[n, 2] - near:
            y = math.copysign(solid[n, 2], y)
        if abs(z) > solid[n, 3] - near:
            z = math.copysign(solid[n, 3], z)
    elif solid[n, 0] == CYLINDER:
        r = math.sqrt(x * x + y * y)
        if r > solid[n, 1] - near and abs(z) > solid[n, 2] - near:
            x, y, z = x * solid[n, 1] / r, y * solid[n, 1] / r, math.copysign(solid[n, 2], z)
    return (
        solid[n, 4] * x + solid[n, 5] * y + solid[n, 6] * z + solid[n, 13],
        solid[n, 7] * x + solid[n, 8] * y + solid[n, 9] * z + solid[n, 14],
        solid[n, 10] * x + solid[n, 11] * y + solid[n, 12] * z + solid[n, 15],
    )
