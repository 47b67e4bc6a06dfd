"""Geodesic distance to the goal among sharp walls, by fast marching with an exact local solver.

Every node carries the point where its shortest path last bends (at first the goal). A node that sees a neighbour's bend
is as far as that bend and the straight way to it; where an obstacle hides it, a string is pulled taut past the obstacle
(`strings.py`). No differences are taken, so nothing is lost at the goal or at an edge (cf. Nash et al. 2007, "Theta*";
Qi and Vladimirsky 2019 on singularities at corners): in free space and behind straight edges distance and gradient are
exact. Along curved walls the string cuts the wall by O(h^2) and carries the curvature of its wave along (`bends.py`);
the error of the distance falls with h^2.

Obstacles (inflated by the margin) and the borders of the grid are walls. Nodes that no path reaches are infinite.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from hotice.compiled import compiled
from hotice.fields.geodesic.bends import WIDTH, distance, reach, source
from hotice.fields.geodesic.memory import BOX, Searches, code_of, forget, mix, no_searches, recall
from hotice.fields.geodesic.segments import blocker
from hotice.fields.geodesic.shadows import FREE_M, see_goal
from hotice.fields.geodesic.strings import join, pull
from hotice.fields.solids import Space, distance_within

_NOTHING = np.empty((0, 6))
_SLACK_PER_M2 = 20.0
"""A path longer than the straight way to its bend by less than this times h^3 is not improved: what is lost at each of
O(1/h) bends falls with h^2 in all."""


_NEW, _NONE = -1, -2
"""Instead of a side: the path bends somewhere new; there is no path."""


def solve_geodesic(
    space: Space, margin_m: float, goal_W: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Distance of every node to the goal (inf: unreachable), (size,) [m], and its gradient, (size, 3).

    The gradient is of length 1, and 0 where the distance is infinite. A goal inside the inflated obstacles is entered
    from its nearest free node.
    """
    return solve_again(space, margin_m, goal_W, no_searches(), _NOTHING)[:2]


def solve_again(
    space: Space, margin_m: float, goal_W: NDArray[np.float64], searches: Searches, changed: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], Searches]:
    """What `solve_geodesic` gives, bit for bit, and the searches of paths to be given the next time.

    `searches`: of the last time, for the same grid and margin; what they hold may be overwritten. `changed` (M, 6):
    boxes of what has changed since, see `changes.py`.
    """
    goal, start = _entry(space, margin_m, goal_W)
    keeps = len(searches.first) > 0
    if not math.isfinite(start):
        return np.full(len(space.sdf), np.inf), np.zeros((len(space.sdf), 3)), no_searches(keeps * len(space.sdf))
    if keeps:
        if searches.count[0] > len(searches.first):
            searches = no_searches(len(searches.first))
        if tuple(searches.goal) != goal:
            searches = searches._replace(seen=no_searches().seen, goal=np.array(goal))
        forget(searches, changed)
    return _march(space, margin_m, goal, start, searches, changed)


def _entry(space: Space, margin_m: float, goal_W: NDArray[np.float64]) -> tuple[tuple[float, float, float], float]:
    """Where paths end and how far that is from the goal; inf when all is wall."""
    x, y, z = goal_W.tolist()
    if distance_within(space, x, y, z) - margin_m > FREE_M:
        return (x, y, z), 0.0
    free = np.flatnonzero(space.sdf - margin_m > FREE_M)
    if not len(free):
        return (x, y, z), math.inf
    index = np.stack(np.unravel_index(free, (space.nx, space.ny, space.nz)), axis=-1)
    p_W = np.array([space.ox, space.oy, space.oz]) + index * space.h
    away = np.linalg.norm(p_W - goal_W, axis=1)
    nearest = int(np.argmin(away))
    return tuple(p_W[nearest].tolist()), float(away[nearest])


@compiled(nogil=True, error_model="numpy")
def _march(space, margin, goal, start, searches, changed):
    """`solve_again` from a free point `goal` that lies `start` from the true one."""
    size = len(space.sdf)
    dist = np.full(size, np.inf)
    rows, codes = np.empty((1024, WIDTH)), np.empty(1024, np.uint64)
    _set(rows, 0, source(goal, start))
    codes[0] = code_of(rows.view(np.uint64), 0)
    used = 1
    first, code, link, found, kept, seen, last = searches
    keeps = len(first) > 0
    box = np.empty(6)
    row_of = np.zeros(size, np.int32)
    # What sees the goal is final at once; only what is hidden from it has to be marched.
    known = see_goal(space, margin, goal, seen, changed)
    seen = known.copy() if keeps else known
    waiting = 0
    for node in range(size):
        if known[node]:
            dist[node] = start + distance(goal, _position(space, node))
        elif space.sdf[node] - margin > FREE_M:
            waiting += 1
    heap = np.empty(waiting, np.int32)
    slot = np.full(size if waiting else 0, -1, np.int32)
    certain = np.zeros(size if waiting else 0, np.bool_)
    count = 0
    if waiting:
        for node in range(size):
            # A lower bound, as if the goal were in sight: the true path is found when the node comes up.
            if not known[node] and space.sdf[node] - margin > FREE_M and _beside(space, node, known):
                dist[node] = start + distance(goal, _position(space, node))
                slot[node] = count
                count += 1
                _sift_up(heap, slot, dist, node)
    while count > 0:
        node = heap[0]
        # Queued values are lower bounds. The costly search for a path is put off until a node is first in the heap; its
        # value is then that bound or more, so the node may sink and come up again.
        if not certain[node]:
            if used == len(rows):
                rows = np.concatenate((rows, np.empty_like(rows)))
                codes = np.concatenate((codes, np.empty_like(codes)))
            at = -1
            if keeps:
                wanted = _beginning(space, margin, node, dist, codes, row_of, known)
                at = recall(first, code, link, node, wanted)
            if at >= 0:
                value, side, new = found[at, 0], link[at, 1], _get(found[:, 1:], at)
            else:
                value, side, new = _evaluate(space, margin, node, dist, rows, row_of, known, box)
                if keeps:
                    n = kept[0]
                    if n == len(code):
                        code, link = np.concatenate((code, code)), np.concatenate((link, link))
                        found = np.concatenate((found, found))
                    code[n], link[n, 0], link[n, 1], found[n, 0], found[n, BOX:] = wanted, first[node], side, value, box
                    _set(found[:, 1:], n, new)
                    first[node] = n
                    kept[0] += 1
            row = 0
            if side == _NEW:
                _set(rows, used, new)
                codes[used] = code_of(rows.view(np.uint64), used)
                row = used
                used += 1
            elif side >= 0:
                row = row_of[_neighbour(space, node, side)]
            dist[node] = value
            row_of[node] = row
            certain[node] = True
            _sift_down(heap, slot, dist, count, node)
            continue
        count -= 1
        slot[node] = -1
        if count > 0:
            _sift_down(heap, slot, dist, count, heap[count])
        # Infinite: walls are between the node and all its known neighbours. A later neighbour may queue it again.
        if dist[node] < np.inf:
            known[node] = True
            count = _spread(space, margin, node, dist, _get(rows, row_of[node]), certain, known, heap, slot, count)
    return dist, _slopes(space, dist, rows, row_of), Searches(first, code, link, found, kept, seen, last)


@compiled(nogil=True, error_model="numpy")
def _slopes(space, dist, rows, row_of):
    """Gradient of the distance, (size, 3): away from the bend."""
    gradient = np.zeros((len(dist), 3))
    for node in range(len(dist)):
        if dist[node] < np.inf:
            p = _position(space, node)
            b = (rows[0, 0], rows[0, 1], rows[0, 2])
            # Row 0 is the goal, a point: nothing slides there.
            if row_of[node] > 0:
                b = reach(_get(rows, row_of[node]), p)[1]
            away = distance(p, b)
            if away > 0.0:
                gradient[node, 0] = (p[0] - b[0]) / away
                gradient[node, 1] = (p[1] - b[1]) / away
                gradient[node, 2] = (p[2] - b[2]) / away
    return gradient


@compiled(inline="always", error_model="numpy")
def _position(space, node):
    i, k = node // (space.ny * space.nz), node % space.nz
    j = node // space.nz - i * space.ny
    return space.ox + i * space.h, space.oy + j * space.h, space.oz + k * space.h


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
def _beside(space, node, known):
    """Whether a neighbour of `node` is known."""
    for side in range(6):
        other = _neighbour(space, node, side)
        if other >= 0 and known[other]:
            return True
    return False


@compiled(nogil=True, error_model="numpy")
def _spread(space, margin, node, dist, row, certain, known, heap, slot, count):
    """Queues the neighbours of a known node by the straight way to its bend; returns the length of the heap."""
    slack = _SLACK_PER_M2 * space.h**3
    for side in range(6):
        other = _neighbour(space, node, side)
        if other < 0 or known[other] or space.sdf[other] - margin <= FREE_M:
            continue
        least, _ = reach(row, _position(space, other))
        if least < dist[other] - slack:
            dist[other] = least
            # Also a path that was certain is looked for again: this neighbour may offer a shorter one.
            certain[other] = False
            if slot[other] < 0:
                slot[other] = count
                count += 1
            _sift_up(heap, slot, dist, other)
    return count


@compiled(nogil=True, error_model="numpy")
def _beginning(space, margin, node, dist, codes, row_of, known):
    """Code of all that `_evaluate` begins from, but obstacles."""
    code, bits = np.uint64(1), dist.view(np.uint64)
    for side in range(6):
        other = _neighbour(space, node, side)
        if other >= 0 and known[other]:
            how = np.uint64(2 * side + 2 + _covered(space, margin, node, other))
            code = mix(mix(mix(code, how), codes[row_of[other]]), bits[other])
    return code


@compiled(inline="always", error_model="numpy")
def _covered(space, margin, node, other):
    """Whether two free balls about neighbours are together as wide as the step."""
    return space.sdf[node] + space.sdf[other] - 2.0 * margin >= space.h


@compiled(nogil=True, error_model="numpy")
def _evaluate(space, margin, node, dist, rows, row_of, known, box):
    """(value, side, new): shortest path of `node` by way of its known neighbours; inf without any.

    In this order: by a neighbour's bend that `node` sees, by a string pulled past the wall that hides one, and by a
    step from a neighbour where no string is found. The path bends as that of the neighbour at `side` or, where that is
    `_NEW`, as `new`; `_NONE`: there is no path. `box` (6,) becomes that of all points asked about, see `join`.
    """
    h = space.h
    slack = _SLACK_PER_M2 * h * h * h
    x = _position(space, node)
    for i in range(3):
        box[i], box[3 + i] = x[i] - h, x[i] + h
    near, hidden, hider = np.full(6, np.inf), np.full(6, np.inf), np.full(6, -1)
    for side in range(6):
        other = _neighbour(space, node, side)
        if other >= 0 and known[other]:
            near[side], _ = reach(_get(rows, row_of[other]), x)
    best, step = np.inf, np.inf
    chosen, new = _NONE, _get(rows, 0)
    # The most promising first; a path over a bend is never shorter than the value in `near`.
    while near.min() < min(best, step) - slack:
        side = near.argmin()
        other = _neighbour(space, node, side)
        hidden[side] = near[side]
        near[side] = np.inf
        value, hider[side] = join(space, margin, _get(rows, row_of[other]), x, best, box)
        if value < np.inf:
            best = value
            chosen = side
            hidden[side] = np.inf
            continue
        y = _position(space, other)
        # Two free balls that together are as wide as the step cover it: no need to ask for a blocker.
        if not _covered(space, margin, node, other) and blocker(space, margin, y, x) >= 0:
            hidden[side] = np.inf
        elif dist[other] + h < min(best, step):
            step = dist[other] + h
            chosen, new = _NEW, source(y, dist[other])
    tried = False
    # Strings are costly: one is pulled, and more only as long as no path over a bend is known.
    while hidden.min() < best - slack and not (tried and best < np.inf):
        side = hidden.argmin()
        other = _neighbour(space, node, side)
        hidden[side] = np.inf
        tried = True
        row = _get(rows, row_of[other])
        value, row = pull(space, margin, row, _position(space, other), x, hider[side], min(best, step), box)
        if value < best:
            best = value
            chosen, new = _NEW, row
    return min(best, step), chosen, new


@compiled(inline="always", error_model="numpy")
def _get(rows, n):
    b = rows[n]
    return (b[0], b[1], b[2], b[3], b[4], b[5], b[6], b[7], b[8], b[9], b[10])


@compiled(inline="always", error_model="numpy")
def _set(rows, n, row):
    for i in range(WIDTH):
        rows[n, i] = row[i]


@compiled
def _sift_up(heap, slot, dist, node):
    i = slot[node]
    while i > 0:
        parent = (i - 1) >> 1
        if dist[heap[parent]] <= dist[node]:
            break
        heap[i] = heap[parent]
        # `slot` follows every move, so that the place of a node in the heap is known without a search.
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
