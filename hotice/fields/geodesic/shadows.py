"""Visibility of the goal from grid nodes, in compiled code: whole blocks at once, node by node along shadow lines."""

from __future__ import annotations

import math

import numpy as np

from hotice.compiled import compiled
from hotice.fields.geodesic.mesh_segments import stays_off
from hotice.fields.geodesic.segments import DEPTH_PER_M, blocker, convex_clearance, depth_of, overlap, passes_box
from hotice.fields.solids import MESH

FREE_M = 1e-6
"""Nodes closer to an obstacle than this count as inside."""
_BLOCK = 8


@compiled(nogil=True, error_model="numpy")
def see_goal(space, margin, goal, before, changed):
    """Whether each node is free and sees the goal, (size,).

    `before`: what it was when obstacles in the boxes `changed` (M, 6) were others; of no nodes: not known.
    """
    nx, ny, nz, h = space.nx, space.ny, space.nz, space.h
    seen = before.copy() if len(before) else np.zeros(len(space.sdf), np.bool_)
    stack = [
        (i, j, k, _BLOCK)
        for i in range(0, nx, _BLOCK)
        for j in range(0, ny, _BLOCK)
        for k in range(0, nz, _BLOCK)
        if len(before) == 0 or _may_change(space, goal, i, j, k, changed)
    ]
    while len(stack):
        i, j, k, width = stack.pop()
        if i >= nx or j >= ny or k >= nz:
            continue
        if width == 1:
            node = (i * ny + j) * nz + k
            p = (space.ox + i * h, space.oy + j * h, space.oz + k * h)
            seen[node] = space.sdf[node] - margin > FREE_M and blocker(space, margin, goal, p) < 0
            continue
        verdict = _beam(space, margin, goal, i, j, k, width)
        if verdict != 0:
            for a in range(i, min(i + width, nx)):
                for b in range(j, min(j + width, ny)):
                    seen[(a * ny + b) * nz + k : (a * ny + b) * nz + min(k + width, nz)] = verdict > 0
        else:
            # Along shadow lines blocks are halved, down to single nodes.
            half = width // 2
            for part in range(8):
                stack.append((i + half * (part >> 2), j + half * (part >> 1 & 1), k + half * (part & 1), half))
    return seen


@compiled(nogil=True, error_model="numpy")
def _may_change(space, goal, i, j, k, changed):
    """Whether the ways from the goal to the nodes of a block of the largest width may meet one of the boxes."""
    half = 0.5 * (_BLOCK - 1)
    for m in range(len(changed)):
        low, high = 0.0, 1.0
        for axis in range(3):
            first, number = (space.ox, i) if axis == 0 else (space.oy, j) if axis == 1 else (space.oz, k)
            way = first + (number + half) * space.h - goal[axis]
            # the way to a node stays within half a block of that to the centre, along each axis
            least, most = changed[m, axis] - half * space.h, changed[m, 3 + axis] + half * space.h
            low, high = overlap(low, high, goal[axis], way, least, most)
        if low <= high:
            return True
    return False


@compiled(nogil=True, error_model="numpy")
def _beam(space, margin, goal, i, j, k, width):
    """1: all nodes of a block are free and see the goal, -1: none does, 0: undecided.

    The way to a node r from the block's centre stays within r of the way to the centre.
    """
    solid, h = space.solid, space.h
    half = 0.5 * (width - 1)
    reach = math.sqrt(3.0) * half * h
    centre = (space.ox + (i + half) * h, space.oy + (j + half) * h, space.oz + (k + half) * h)
    touch = DEPTH_PER_M * h * h
    verdict = 1
    for n in range(len(solid)):
        if not passes_box(solid, space.nodes, n, goal, centre, margin + reach + touch):
            continue
        if solid[n, 0] == MESH:
            # A mesh may have holes: it is never sure to hide a whole block.
            if verdict > 0 and not stays_off(space, n, goal, centre, margin + reach + touch):
                verdict = 0
            continue
        # Ways to the nodes stay within `reach` of the way to the centre: cut deeper than this, it tells for all.
        umbra = -depth_of(solid, n, margin, h) - reach
        s, _ = convex_clearance(solid, n, margin, goal, centre, umbra, reach + touch)
        if s < umbra:
            return -1
        if s <= reach + touch:
            verdict = 0
    return verdict
