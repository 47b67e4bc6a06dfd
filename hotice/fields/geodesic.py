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

import numpy as np
from numpy.typing import NDArray

from hotice.compiled import compiled
from hotice.fields.bends import WIDTH, reach, source
from hotice.fields.solids import BLOCK, Space, distance_bound, distance_within
from hotice.fields.strings import DEPTH_PER_M, distance, join, pull, trace

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


@compiled(nogil=True, error_model="numpy")
def _march(space, margin, goal, start):
    """`solve_geodesic` from a free point `goal` that lies `start` from the true one."""
    size = len(space.sdf)
    dist = np.full(size, np.inf)
    bend = np.zeros((size, WIDTH))
    first = source(goal, start)
    known = _visible(space, margin, goal)
    for node in range(size):
        if known[node]:
            dist[node] = start + distance(goal, _position(space, node))
            _set(bend, node, first)
    heap = np.empty(size, np.int64)
    slot = np.full(size, -1, np.int64)
    certain = np.zeros(size, np.bool_)
    count = 0
    for node in range(size):
        if known[node]:
            count = _spread(space, margin, node, dist, bend, certain, known, heap, slot, count)
    while count > 0:
        node = heap[0]
        if not certain[node]:
            dist[node] = _evaluate(space, margin, node, dist, bend, known)
            certain[node] = True
            _sift_down(heap, slot, dist, count, node)
            continue
        count -= 1
        slot[node] = -1
        if count > 0:
            _sift_down(heap, slot, dist, count, heap[count])
        if dist[node] < np.inf:
            known[node] = True
            count = _spread(space, margin, node, dist, bend, certain, known, heap, slot, count)
    gradient = np.zeros((size, 3))
    for node in range(size):
        p = _position(space, node)
        away = distance(p, bend[node])
        if known[node] and away > 0.0:
            for axis in range(3):
                gradient[node, axis] = (p[axis] - bend[node, axis]) / away
    return dist, gradient


@compiled(inline="always", error_model="numpy")
def _position(space, node):
    i, k = node // (space.ny * space.nz), node % space.nz
    j = node // space.nz - i * space.ny
    return space.ox + i * space.h, space.oy + j * space.h, space.oz + k * space.h


@compiled(nogil=True, error_model="numpy")
def _visible(space, margin, goal):
    """Which nodes see the goal, (size,): whole blocks at once, or by halves where walls come near their beams."""
    nx, ny, nz = space.nx, space.ny, space.nz
    seen = np.zeros(len(space.sdf), np.bool_)
    stack = [(i, j, k, BLOCK) for i in range(0, nx, BLOCK) for j in range(0, ny, BLOCK) for k in range(0, nz, BLOCK)]
    while len(stack):
        i, j, k, width = stack.pop()
        if i >= nx or j >= ny or k >= nz:
            continue
        if width == 1:
            node = (i * ny + j) * nz + k
            if space.sdf[node] - margin > _FREE_M:
                seen[node] = trace(space, margin, goal, _position(space, node))[0]
            continue
        verdict = _beam(space, margin, goal, i, j, k, width)
        if verdict > 0:
            for a in range(i, min(i + width, nx)):
                for b in range(j, min(j + width, ny)):
                    seen[(a * ny + b) * nz + k : (a * ny + b) * nz + min(k + width, nz)] = True
        elif verdict == 0:
            half = width // 2
            for part in range(8):
                stack.append((i + half * (part >> 2), j + half * (part >> 1 & 1), k + half * (part & 1), half))
    return seen


@compiled(nogil=True, error_model="numpy")
def _beam(space, margin, goal, i, j, k, width):
    """1: certainly all nodes of a block see the goal, -1: none does, 0: undecided.

    That of a node r from the block's centre stays within f r of the centre's at the fraction f from the goal.
    """
    sdf, h = space.sdf, space.h
    ox, oy, oz, nx, ny, nz = space.ox, space.oy, space.oz, space.nx, space.ny, space.nz
    half = 0.5 * (width - 1)
    reach = math.sqrt(3.0) * half * h
    cx, cy, cz = ox + (i + half) * h, oy + (j + half) * h, oz + (k + half) * h
    dx, dy, dz = goal[0] - cx, goal[1] - cy, goal[2] - cz
    length = math.sqrt(dx * dx + dy * dy + dz * dz)
    verdict = 1
    t = 0.0
    while t < length:
        f = t / length
        s = distance_bound(sdf, ox, oy, oz, h, nx, ny, nz, cx + f * dx, cy + f * dy, cz + f * dz)
        spread = (1.0 - f) * reach
        if s - margin - spread < 0.5 * h:
            s = distance_within(space, cx + f * dx, cy + f * dy, cz + f * dz)
            if s - margin + spread < -DEPTH_PER_M * h * h:
                return -1
            if s - margin - spread < 0.05 * h:
                verdict = 0
        t += max(abs(s - margin) - spread, 0.25 * h)
    return verdict


@compiled(inline="always", error_model="numpy")
def _neighbour(space, node, side):
    """Node beyond side 0 .. 5 of a node, -1 outside the grid."""
    sx, sy = space.ny * space.nz, space.nz
    i, k = node // sx, node % sy
    j = node // sy - i * space.ny
    if side == 0:
        return node - sx if i > 0 else -1
    if side == 1:
        return node + sx if i < space.nx - 1 else -1
    if side == 2:
        return node - sy if j > 0 else -1
    if side == 3:
        return node + sy if j < space.ny - 1 else -1
    if side == 4:
        return node - 1 if k > 0 else -1
    return node + 1 if k < space.nz - 1 else -1


@compiled(nogil=True, error_model="numpy")
def _spread(space, margin, node, dist, bend, certain, known, heap, slot, count):
    """Queues the neighbours of a known node by the straight way to its bend; returns the length of the heap."""
    slack = _SLACK_PER_M * space.h * space.h
    for side in range(6):
        other = _neighbour(space, node, side)
        if other < 0 or known[other] or space.sdf[other] - margin <= _FREE_M:
            continue
        least, _ = reach(bend[node], _position(space, other))
        if least < dist[other] - slack:
            dist[other] = least
            certain[other] = False
            if slot[other] < 0:
                slot[other] = count
                count += 1
            _sift_up(heap, slot, dist, other)
    return count


@compiled(nogil=True, error_model="numpy")
def _evaluate(space, margin, node, dist, bend, known):
    """Length of the shortest path of `node` by way of its known neighbours; inf without any.

    In this order: by a neighbour's bend that `node` sees, by a string pulled past the wall that hides one, and by a
    step from a neighbour where no string is found. Sets the bend of `node`.
    """
    h = space.h
    slack = _SLACK_PER_M * h * h
    x = _position(space, node)
    near, hidden = np.full(6, np.inf), np.full(6, np.inf)
    for side in range(6):
        other = _neighbour(space, node, side)
        if other >= 0 and known[other]:
            near[side], _ = reach(bend[other], x)
    best, step = np.inf, np.inf
    while near.min() < min(best, step) - slack:
        side = near.argmin()
        other = _neighbour(space, node, side)
        hidden[side] = near[side]
        near[side] = np.inf
        value, row = join(space, margin, _get(bend, other), x, best)
        if value < np.inf:
            best = value
            _set(bend, node, row)
            hidden[side] = np.inf
            continue
        y = _position(space, other)
        if space.sdf[node] + space.sdf[other] - 2.0 * margin < h and not trace(space, margin, y, x)[0]:
            hidden[side] = np.inf
        elif dist[other] + h < min(best, step):
            step = dist[other] + h
            _set(bend, node, source(y, dist[other]))
    tried = False
    while hidden.min() < best - slack and not (tried and best < np.inf):
        side = hidden.argmin()
        other = _neighbour(space, node, side)
        hidden[side] = np.inf
        tried = True
        value, row = pull(space, margin, _get(bend, other), _position(space, other), x, min(best, step))
        if value < best:
            best = value
            _set(bend, node, row)
    return min(best, step)


@compiled(inline="always", error_model="numpy")
def _get(bend, n):
    b = bend[n]
    return (b[0], b[1], b[2], b[3], b[4], b[5], b[6], b[7], b[8], b[9], b[10])


@compiled(inline="always", error_model="numpy")
def _set(bend, n, row):
    for i in range(WIDTH):
        bend[n, i] = row[i]


@compiled
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


@compiled
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
