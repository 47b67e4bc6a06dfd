"""Geodesic distance to the goal among sharp walls, by fast marching with an exact local solver.

Every node carries the point where its shortest path last bends (at first the goal). A node that sees a neighbour's bend
is as far as that bend and the straight way to it; one that does not bends the string where it touches the wall, below
the grid's scale (`strings.py`). No differences are taken, so nothing is lost at the goal or at an edge (cf. Nash et al.
2007, "Theta*"; Qi and Vladimirsky 2019 on singularities at corners): in free space distance and gradient are exact, and
elsewhere the value is the length of a path that is free but for the cuts that `strings.py` allows. Errors of the
distance fall with h^2: bends along an edge lie at most a cell apart, and chords of curved walls cut them by O(h^2).

Obstacles (inflated by the margin) and the borders of the grid are walls. Nodes that no path reaches are infinite.
"""

from __future__ import annotations

import math

import numba
import numpy as np
from numpy.typing import NDArray

from hotice.fields.solids import BLOCK, Space, distance_bound, distance_within
from hotice.fields.strings import distance, pull, trace

_FREE_M = 1e-6
"""Nodes closer to an obstacle than this count as inside."""
_SLACK_PER_M = 1.0
"""A path longer than the straight way to its bend by less than this times h^2 is not improved."""


def solve_geodesic(
    space: Space, margin_m: float, goal_W: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Distance of every node to the goal (inf: unreachable), (size,) [m], and its gradient, (size, 3).

    The gradient is of length 1, and 0 where the distance is infinite. A goal inside the inflated obstacles is entered
    from its nearest free node.
    """
    goal, start = _entry(space, margin_m, goal_W)
    if not math.isfinite(start):
        return np.full(len(space.sdf), np.inf), np.zeros((len(space.sdf), 3))
    return _march(space, margin_m, goal, start)


def _entry(space: Space, margin_m: float, goal_W: NDArray[np.float64]) -> tuple[tuple[float, float, float], float]:
    """Where paths end and how far that is from the goal; inf when all is wall."""
    x, y, z = goal_W.tolist()
    if distance_within(space, x, y, z) - margin_m > _FREE_M:
        return (x, y, z), 0.0
    free = np.flatnonzero(space.sdf - margin_m > _FREE_M)
    if not len(free):
        return (x, y, z), math.inf
    index = np.stack(np.unravel_index(free, (space.nx, space.ny, space.nz)), axis=-1)
    p_W = np.array([space.ox, space.oy, space.oz]) + index * space.h
    away = np.linalg.norm(p_W - goal_W, axis=1)
    nearest = int(np.argmin(away))
    return tuple(p_W[nearest].tolist()), float(away[nearest])


@numba.njit(cache=True, nogil=True)
def _march(space, margin, goal, start):
    """`solve_geodesic` from a free point `goal` that lies `start` from the true one."""
    size = len(space.sdf)
    dist = np.full(size, np.inf)
    bend = np.zeros((size, 4))
    known = _visible(space, margin, goal)
    for node in range(size):
        if known[node]:
            dist[node] = start + distance(goal, _position(space, node))
            bend[node, 0], bend[node, 1], bend[node, 2], bend[node, 3] = goal[0], goal[1], goal[2], start
    heap = np.empty(size, np.int64)
    slot = np.full(size, -1, np.int64)
    blocked = np.full(size, -1, np.int64)
    count = 0
    for node in range(size):
        if known[node]:
            count = _spread(space, margin, node, dist, bend, blocked, known, heap, slot, count)
    while count > 0:
        node = heap[0]
        count -= 1
        if count > 0:
            _sift_down(heap, slot, dist, count, heap[count])
        if blocked[node] >= 0:
            _bend(space, margin, node, blocked[node], dist, bend)
        known[node] = True
        count = _spread(space, margin, node, dist, bend, blocked, known, heap, slot, count)
    gradient = np.zeros((size, 3))
    for node in range(size):
        p = _position(space, node)
        away = distance(p, bend[node])
        if known[node] and away > 0.0:
            for axis in range(3):
                gradient[node, axis] = (p[axis] - bend[node, axis]) / away
    return dist, gradient


@numba.njit(cache=True, inline="always")
def _position(space, node):
    i, k = node // (space.ny * space.nz), node % space.nz
    j = node // space.nz - i * space.ny
    return space.ox + i * space.h, space.oy + j * space.h, space.oz + k * space.h


@numba.njit(cache=True, nogil=True)
def _visible(space, margin, goal):
    """Which nodes see the goal, (size,)."""
    seen = np.zeros(len(space.sdf), np.bool_)
    for i in range(0, space.nx, BLOCK):
        for j in range(0, space.ny, BLOCK):
            for k in range(0, space.nz, BLOCK):
                _see(space, margin, goal, seen, i, j, k, BLOCK)
    return seen


@numba.njit(cache=True, nogil=True)
def _see(space, margin, goal, seen, i, j, k, width):
    """Marks the nodes of a block that see the goal: all at once, or by halves where walls come near its beam."""
    if i >= space.nx or j >= space.ny or k >= space.nz:
        return
    if width == 1:
        node = (i * space.ny + j) * space.nz + k
        if space.sdf[node] - margin > _FREE_M:
            seen[node] = trace(space, margin, goal, _position(space, node))[0]
        return
    if _beam_is_free(space, margin, goal, i, j, k, width):
        for a in range(i, min(i + width, space.nx)):
            for b in range(j, min(j + width, space.ny)):
                for c in range(k, min(k + width, space.nz)):
                    seen[(a * space.ny + b) * space.nz + c] = True
        return
    half = width // 2
    for part in range(8):
        _see(space, margin, goal, seen, i + half * (part >> 2), j + half * (part >> 1 & 1), k + half * (part & 1), half)


@numba.njit(cache=True, nogil=True)
def _beam_is_free(space, margin, goal, i, j, k, width):
    """Whether the segments from all nodes of a block to the goal are certainly free.

    That of a node r from the block's centre stays within f r of the centre's at the fraction f from the goal.
    """
    sdf, h = space.sdf, space.h
    ox, oy, oz, nx, ny, nz = space.ox, space.oy, space.oz, space.nx, space.ny, space.nz
    half = 0.5 * (width - 1)
    reach = math.sqrt(3.0) * half * h
    cx, cy, cz = ox + (i + half) * h, oy + (j + half) * h, oz + (k + half) * h
    dx, dy, dz = goal[0] - cx, goal[1] - cy, goal[2] - cz
    length = math.sqrt(dx * dx + dy * dy + dz * dz)
    t = 0.0
    while t < length:
        f = t / length
        s = distance_bound(sdf, ox, oy, oz, h, nx, ny, nz, cx + f * dx, cy + f * dy, cz + f * dz)
        spare = s - margin - (1.0 - f) * reach
        if spare < 0.1 * h:
            return False
        t += spare
    return True


@numba.njit(cache=True, nogil=True)
def _spread(space, margin, node, dist, bend, blocked, known, heap, slot, count):
    """Offers the path through a known node to its neighbours; returns the length of the heap."""
    sx, sy = space.ny * space.nz, space.nz
    i, j, k = node // sx, node // sy % space.ny, node % sy
    for axis in range(3):
        for sign in (-1, 1):
            if axis == 0:
                other, inside = node + sign * sx, 0 <= i + sign < space.nx
            elif axis == 1:
                other, inside = node + sign * sy, 0 <= j + sign < space.ny
            else:
                other, inside = node + sign, 0 <= k + sign < space.nz
            if not inside or known[other] or space.sdf[other] - margin <= _FREE_M:
                continue
            if _offer(space, margin, node, other, dist, bend, blocked):
                if slot[other] < 0:
                    slot[other] = count
                    count += 1
                _sift_up(heap, slot, dist, other)
    return count


@numba.njit(cache=True, nogil=True)
def _offer(space, margin, node, other, dist, bend, blocked):
    """Shortens the path of `other` by way of the bend of `node`, or else of `node`; returns whether it did.

    `blocked[other]` keeps the neighbour whose bend would be the best one if no wall hid it.
    """
    h = space.h
    x, a = _position(space, other), (bend[node, 0], bend[node, 1], bend[node, 2])
    value = bend[node, 3] + distance(a, x)
    if value >= dist[other] - _SLACK_PER_M * h * h:
        return False
    if trace(space, margin, a, x)[0]:
        dist[other] = value
        bend[other] = bend[node]
        return True
    y = _position(space, node)
    if space.sdf[node] + space.sdf[other] - 2.0 * margin < h and not trace(space, margin, y, x)[0]:
        return False
    rival = blocked[other]
    if rival < 0 or value < bend[rival, 3] + distance(bend[rival], x):
        blocked[other] = node
    if dist[node] + h >= dist[other]:
        return False
    dist[other] = dist[node] + h
    bend[other, 0], bend[other, 1], bend[other, 2], bend[other, 3] = y[0], y[1], y[2], dist[node]
    return True


@numba.njit(cache=True, nogil=True)
def _bend(space, margin, node, other, dist, bend):
    """Shortens the path of `node` by a string that bends past the wall which hides the bend of `other` from it."""
    x, a, d = _position(space, node), (bend[other, 0], bend[other, 1], bend[other, 2]), bend[other, 3]
    if d + distance(a, x) >= dist[node] - _SLACK_PER_M * space.h * space.h:
        return
    value, b, d = pull(space, margin, a, d, _position(space, other), x, dist[node])
    if value < dist[node]:
        dist[node] = value
        bend[node, 0], bend[node, 1], bend[node, 2], bend[node, 3] = b[0], b[1], b[2], d


@numba.njit(cache=True)
def _sift_up(heap, slot, dist, node):
    i = slot[node]
    while i > 0:
        parent = (i - 1) >> 1
        if dist[heap[parent]] <= dist[node]:
            break
        heap[i] = heap[parent]
        slot[heap[i]] = i
        i = parent
    heap[i] = node
    slot[node] = i


@numba.njit(cache=True)
def _sift_down(heap, slot, dist, count, node):
    i = 0
    while True:
        child = 2 * i + 1
        if child >= count:
            break
        if child + 1 < count and dist[heap[child + 1]] < dist[heap[child]]:
            child += 1
        if dist[heap[child]] >= dist[node]:
            break
        heap[i] = heap[child]
        slot[heap[i]] = i
        i = child
    heap[i] = node
    slot[node] = i
