"""A search over place and heading of an envelope, then over postures along the path, in compiled code."""

from __future__ import annotations

import heapq
import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hotice.compiled import compiled
from hotice.model.generate.envelope import CORE, FEET, POSTURES, SHINS, Envelope

HEADINGS = (
    (1, 0),
    (2, 1),
    (1, 1),
    (1, 2),
    (0, 1),
    (-1, 2),
    (-1, 1),
    (-2, 1),
    (-1, 0),
    (-2, -1),
    (-1, -1),
    (-1, -2),
    (0, -1),
    (1, -2),
    (1, -1),
    (2, -1),
)
"""Directions on the grid, counter-clockwise: the headings, and the moves from place to place."""
STRIDE_M = 0.52
ROOMY_M, CAP_M = 0.10, 0.20
"""A path with less clearance than the first costs up to half as much again; no clearance above the second is known."""
TURN_COST_M, POSTURE_COST_M = 0.03, 0.02
GREED = 1.3
"""Weight of the way still to go: a path costs at most this much more than the cheapest, and is found sooner."""
_MOVES = np.array(HEADINGS)
_ANGLES = np.arctan2(_MOVES[:, 1], _MOVES[:, 0])
_EFFORT = np.array([p.effort for p in POSTURES])
_CHANGES = np.array([[p.is_next_to(q) for q in POSTURES] for p in POSTURES])


@dataclass(frozen=True, kw_only=True)
class BodyGrid:
    """Sampled distance and the places of the pelvis.

    Attributes:
        distance: (nx, ny, nz) signed distance [m] at `origin + index * resolution_m`; origin (3,) in W [m].
        first: (2,) x, y of place (0, 0) in W [m]; size: places along x and y.
    """

    distance: NDArray[np.float32]
    origin: NDArray[np.float64]
    first: NDArray[np.float64]
    size: tuple[int, int]
    resolution_m: float

    def places(self, index: NDArray[np.integer]) -> NDArray[np.float64]:
        """Positions of places, (n, 2) indices -> (n, 2) in W [m]."""
        return self.first + index * self.resolution_m

    def cells(self, p_W: NDArray[np.float64]) -> NDArray[np.float64]:
        """The inverse of `places`, fractions included."""
        return (p_W - self.first) / self.resolution_m


@dataclass(frozen=True, kw_only=True)
class LatticePath:
    """A path; when `found` is false, one that ends as near to the goal as the robot comes, or just that place.

    Attributes:
        node: (n, 4) place along x, along y, heading, posture. stands: (n,) whether the feet do; false amid a stride.
        clearance: (n,) of the envelope [m], at most `CAP_M`; where a foot is in the air, of the rest.
    """

    found: bool
    node: NDArray[np.int64]
    stands: NDArray[np.bool_]
    clearance: NDArray[np.float64]


class _Room(NamedTuple):
    """Room that the clearance of a block is computed in; `known` remembers it by place, heading and block."""

    distance: NDArray
    offset: NDArray
    h: float
    cos: NDArray
    sin: NDArray
    centre: NDArray
    radius: NDArray
    first: NDArray
    ball: NDArray
    posture_blocks: NDArray
    known: NDArray
    margin: float


def search(
    grid: BodyGrid,
    envelope: Envelope,
    start: tuple[float, float, float],
    goal: tuple[float, float],
    goal_radius_m: float,
    margin_m: float,
) -> LatticePath:
    """A cheap path from `start` to within `goal_radius_m` of the goal.

    First the way on the floor, where each move needs one posture that is free at both of its ends; then the postures
    along that way, changed step by step. A path found is sound; one that exists may be missed when postures that are
    free at the same places cannot be changed into each other there.
    """
    h = grid.resolution_m
    room = _Room(
        grid.distance,
        (grid.first - grid.origin[:2]) / h,
        h,
        np.cos(_ANGLES),
        np.sin(_ANGLES),
        envelope.centre,
        envelope.radius,
        envelope.first,
        envelope.ball,
        envelope.posture_blocks,
        np.full((*grid.size, len(HEADINGS), len(envelope.ball)), np.nan),
        margin_m,
    )
    here, there = grid.cells(np.array(start[:2])), grid.cells(np.array(goal))
    i, j = np.rint(here).astype(int).tolist()
    heading = int(np.argmax(np.cos(_ANGLES - start[2])))
    rest = _core_distance(room, CORE, _MOVES, there, goal_radius_m)
    if np.isfinite(rest[i, j]):
        found, state = _search(room, _EFFORT, _MOVES, (i, j, heading), rest)
        node = _fill_strides(np.stack(np.unravel_index(state, (*grid.size, len(HEADINGS))), axis=1))
    else:
        reached = np.argwhere(np.isfinite(_core_distance(room, CORE, _MOVES, here, 0.5 * h)))
        last = reached[np.linalg.norm(reached - there, axis=1).argmin()] if len(reached) else (i, j)
        found, node = False, np.array([[*last, heading]])
    feet = np.array([_block_clearance(room, i, j, k, FEET) for i, j, k in node.tolist()])
    stands = feet >= margin_m
    posture = _postures(room, _EFFORT, _CHANGES, node, stands)
    if (posture < 0).any():
        found, last = False, max(1, int(np.argmin(posture)))  # the first without a posture, which is -1
        node, feet, stands, posture = node[:last], feet[:last], stands[:last], np.maximum(posture[:last], 0)
    node = np.column_stack([node, posture])
    upper = np.array([_upper_clearance(room, *n) for n in node.tolist()])
    clearance = np.where(stands, np.minimum(upper, feet), upper)
    return LatticePath(found=bool(found), node=node, stands=stands, clearance=clearance)


def _fill_strides(node: NDArray[np.int64]) -> NDArray[np.int64]:
    """Path with the places amid strides, (n, 3) -> (m, 3): moves of several steps along the heading in single steps."""
    filled = [node[:1]]
    for a, b in zip(node[:-1], node[1:], strict=True):
        along, move = _MOVES[a[2]], b[:2] - a[:2]
        steps = max(1, int(move @ along // (along @ along)))
        straight = (move == steps * along).all()
        filled.append(a + (b - a) * np.arange(1, steps + 1)[:, None] // steps if straight else b[None])
    return np.concatenate(filled)


@compiled
def _sample(distance, x, y, z):
    """Trilinear value at a position in units of cells, held constant beyond the border."""
    nx, ny, nz = distance.shape
    x, y, z = min(max(x, 0.0), nx - 1.001), min(max(y, 0.0), ny - 1.001), min(max(z, 0.0), nz - 1.001)
    i, j, k = int(x), int(y), int(z)
    u, v, w = x - i, y - j, z - k
    a = (distance[i, j, k] * (1 - w) + distance[i, j, k + 1] * w) * (1 - v)
    a += (distance[i, j + 1, k] * (1 - w) + distance[i, j + 1, k + 1] * w) * v
    b = (distance[i + 1, j, k] * (1 - w) + distance[i + 1, j, k + 1] * w) * (1 - v)
    b += (distance[i + 1, j + 1, k] * (1 - w) + distance[i + 1, j + 1, k + 1] * w) * v
    return a * (1 - u) + b * u


@compiled
def _block_clearance(room, i, j, k, block):
    """Least distance of a block to the obstacles [m], at most `CAP_M`; some value below the margin when it is less."""
    least = room.known[i, j, k, block]
    if not np.isnan(least):
        return least
    x, y, cos, sin = i + room.offset[0], j + room.offset[1], room.cos[k] / room.h, room.sin[k] / room.h
    bx, by, bz, reach = room.ball[block]
    least = CAP_M
    if _sample(room.distance, x + cos * bx - sin * by, y + sin * bx + cos * by, bz / room.h) - reach < CAP_M:
        for s in range(room.first[block], room.first[block + 1]):
            cx, cy, cz = room.centre[s]
            value = _sample(room.distance, x + cos * cx - sin * cy, y + sin * cx + cos * cy, cz / room.h)
            least = min(least, value - room.radius[s])
            if least < room.margin:
                break
    room.known[i, j, k, block] = least
    return least


@compiled
def _upper_clearance(room, i, j, k, p):
    """Clearance of everything but the feet in posture p."""
    least = _block_clearance(room, i, j, k, SHINS)
    for block in room.posture_blocks[p]:
        if least >= room.margin:
            least = min(least, _block_clearance(room, i, j, k, block))
    return least


@compiled
def _stands(room, i, j, k):
    return _block_clearance(room, i, j, k, FEET) >= room.margin


@compiled
def _inside(room, i, j):
    return 0 <= i < room.known.shape[0] and 0 <= j < room.known.shape[1]


@compiled
def _core_distance(room, core, moves, goal, radius):
    """Lower bound of the way to within `radius` of the goal, from what all postures share, (nx, ny) [m]; inf: none."""
    nx, ny = room.known.shape[:2]
    closed = np.ones((nx, ny), dtype=np.bool_)
    length = np.full((nx, ny), np.inf)
    queue = [(0.0, 0, 0) for _ in range(0)]
    for i in range(nx):
        for j in range(ny):
            least = np.inf
            for z, ball in core:
                least = min(least, _sample(room.distance, i + room.offset[0], j + room.offset[1], z / room.h) - ball)
            closed[i, j] = least < room.margin
            if not closed[i, j] and math.hypot(i - goal[0], j - goal[1]) * room.h <= radius:
                length[i, j] = 0.0
                heapq.heappush(queue, (0.0, i, j))
    while len(queue) > 0:
        _, i, j = heapq.heappop(queue)
        if closed[i, j]:
            continue
        closed[i, j] = True
        for dx, dy in moves:
            x, y = i + dx, j + dy
            if _inside(room, x, y) and not closed[x, y]:
                way = length[i, j] + math.hypot(dx, dy) * room.h
                if way < length[x, y]:
                    length[x, y] = way
                    heapq.heappush(queue, (way, x, y))
    return length


@compiled
def _common(room, i, j, k, x, y, n):
    """The least posture that is free at both of two states, and its clearance at the second; -1 if there is none."""
    if not _inside(room, x, y) or not _stands(room, x, y, n):
        return -1, 0.0
    for p in range(len(room.posture_blocks)):
        if _upper_clearance(room, i, j, k, p) >= room.margin:
            clearance = _upper_clearance(room, x, y, n, p)
            if clearance >= room.margin:
                return p, min(clearance, _block_clearance(room, x, y, n, FEET))
    return -1, 0.0


@compiled
def _stride(room, move, i, j, k):
    """Steps straight ahead to the next foothold in reach, and the least posture free all along; (0, -1) if none."""
    for n in range(2, int(STRIDE_M / (math.hypot(move[0], move[1]) * room.h) + 1e-9) + 1):
        x, y = i + n * move[0], j + n * move[1]
        if not _inside(room, x, y):
            break
        if _stands(room, x, y, k):
            for p in range(len(room.posture_blocks)):
                free = True
                for m in range(n + 1):
                    free = free and _upper_clearance(room, i + m * move[0], j + m * move[1], k, p) >= room.margin
                if free:
                    return n, p
            break
    return 0, -1


@compiled
def _search(room, effort, moves, start, rest):
    """A* over place and heading: whether the goal was reached, and the states to it or to the nearest place."""
    nx, ny, headings = room.known.shape[:3]
    count = nx * ny * headings
    cost, closed = np.full(count, np.inf), np.zeros(count, dtype=np.bool_)
    parent = np.full(count, -1)
    i, j, k = start
    best = (i * ny + j) * headings + k
    nearest = np.inf
    cost[best] = 0.0
    queue = [(rest[i, j], best)]
    if _common(room, i, j, k, i, j, k)[0] < 0:
        queue.clear()
    while len(queue) > 0 and nearest > 0.0:
        state = heapq.heappop(queue)[1]
        if closed[state]:
            continue
        closed[state] = True
        k, j, i = state % headings, state // headings % ny, state // (headings * ny)
        if rest[i, j] < nearest:
            best, nearest = state, rest[i, j]
        for candidate in range(headings + 2):
            x, y, n, price = i, j, k, TURN_COST_M
            if candidate < headings:
                dx, dy = moves[candidate]
                ahead = room.cos[candidate] * room.cos[k] + room.sin[candidate] * room.sin[k]
                price = math.hypot(dx, dy) * room.h * (1.3 - 0.3 * ahead)
                x, y = i + dx, j + dy
            else:
                n = (k + 2 * (candidate - headings) + headings - 1) % headings
            p, clearance = _common(room, i, j, k, x, y, n)
            if p < 0 and candidate == k:
                steps, p = _stride(room, moves[k], i, j, k)
                if p >= 0:
                    x, y, price, clearance = i + steps * dx, j + steps * dy, price * steps, room.margin
            if p < 0:
                continue
            after = (x * ny + y) * headings + n
            total = cost[state] + price * effort[p] * (1.0 + 0.5 * max(0.0, 1.0 - clearance / ROOMY_M))
            if not closed[after] and total < cost[after]:
                cost[after] = total
                parent[after] = state
                heapq.heappush(queue, (total + GREED * rest[x, y], after))
    path = [best]
    while parent[path[-1]] >= 0:
        path.append(parent[path[-1]])
    return nearest == 0.0, np.array(path[::-1])


@compiled
def _postures(room, effort, changes, node, stands):
    """Cheapest free postures along a path, (n,), changed by single free steps, not amid strides; -1: none."""
    count, postures = len(node), len(effort)
    cost = np.full((count, postures), np.inf)
    parent = np.full((count, postures), -1)
    for n in range(count):
        i, j, k = node[n]
        price = 0.5 * room.h
        if n > 0:
            price += math.hypot(i - node[n - 1, 0], j - node[n - 1, 1]) * room.h
        for p in range(postures):
            clearance = _upper_clearance(room, i, j, k, p)
            if clearance >= room.margin:
                before = effort[p] - 1.0 if n == 0 else cost[n - 1, p]
                cost[n, p] = before + price * effort[p] * (1.0 + 0.5 * max(0.0, 1.0 - clearance / ROOMY_M))
                parent[n, p] = p
        if stands[n]:
            for _ in range(postures):
                for p in range(postures):
                    for q in range(postures):
                        better = cost[n, p] + POSTURE_COST_M < cost[n, q]
                        if changes[p, q] and better and _upper_clearance(room, i, j, k, q) >= room.margin:
                            cost[n, q] = cost[n, p] + POSTURE_COST_M
                            parent[n, q] = parent[n, p]
    last = count - 1
    while last >= 0 and not np.isfinite(cost[last]).any():
        last -= 1
    best = np.full(count, -1)
    if last >= 0:
        best[last] = np.argmin(cost[last])
        for n in range(last, 0, -1):
            best[n - 1] = parent[n, best[n]]
    return best
