"""Geodesic distance to the goal by second-order fast marching in compiled code, and its extension into walls.

Obstacles (inflated by the margin) and the borders of the grid are walls. Nodes within three cells of the goal that see
it hold the exact Euclidean distance. Nodes that no path reaches are infinite.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from hotice.fields.distance import Grid, distance_at, open_edges, segments_blocked
from hotice.model.scene import Scene

SEED_RADIUS_CELLS = 3.0


def solve_geodesic(
    scene: Scene, grid: Grid, sdf: NDArray[np.float64], margin_m: float
) -> tuple[NDArray[np.float64], NDArray[np.uint8]]:
    """Distance of every node to the goal (inf: unreachable), (size,) [m], and the open edges, (size,) bits.

    `sdf`: raw signed distance at the nodes. A goal inside the inflated obstacles is entered from its nearest free node.
    """
    bits = open_edges(scene, grid, sdf, margin_m)
    node, value = seed_nodes(scene, grid, sdf, margin_m)
    geodesic = fast_march(node, value, bits, np.array(grid.shape), grid.resolution_m)
    return geodesic, bits


def seed_nodes(
    scene: Scene, grid: Grid, sdf: NDArray[np.float64], margin_m: float
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Nodes about the goal, (n,) flat indices, and their straight distance to it, (n,) [m]."""
    g_W = scene.goal_W
    free = np.flatnonzero(sdf - margin_m > 1e-6)
    if not len(free):
        return free, np.zeros(0)
    p_W = grid.points(free)
    distance = np.linalg.norm(p_W - g_W, axis=1)
    near = distance <= SEED_RADIUS_CELLS * grid.resolution_m
    if near.any() and distance_at(scene, g_W[None])[0] > margin_m:
        ends = p_W[near]
        near[near] = ~segments_blocked(scene, np.broadcast_to(g_W, ends.shape), ends, margin_m)
    else:
        near[:] = False
    if not near.any():
        near[np.argmin(distance)] = True
    return free[near], distance[near]


@numba.njit(cache=True, nogil=True)
def fast_march(seed, seed_value, bits, shape, h):
    """Solves |grad D| = 1 from the seeds over open edges; returns (size,), inf where unreachable.

    `bits`: see `open_edges`; flat indices, z fastest. Second-order upwind differences where two upwind neighbours in a
    row are known (Sethian 1999), first-order elsewhere.
    """
    size = shape[0] * shape[1] * shape[2]
    stride = np.array([shape[1] * shape[2], shape[2], 1])
    dist = np.full(size, np.inf)
    known = np.zeros(size, np.bool_)
    heap = np.empty(size, np.int64)
    slot = np.full(size, -1, np.int64)
    count = 0
    for n in range(len(seed)):
        dist[seed[n]] = seed_value[n]
        known[seed[n]] = True
    todo = 0
    while True:
        if todo < len(seed):
            node = seed[todo]
            todo += 1
        elif count > 0:
            node = heap[0]
            count -= 1
            if count > 0:
                _sift_down(heap, slot, dist, count, heap[count])
            known[node] = True
        else:
            return dist
        for axis in range(3):
            for sign in (-1, 1):
                other = _step(node, axis, sign, stride, bits)
                if other < 0 or known[other]:
                    continue
                value = _upwind(other, dist, known, stride, bits, h)
                if value < dist[other]:
                    dist[other] = value
                    if slot[other] < 0:
                        slot[other] = count
                        count += 1
                    _sift_up(heap, slot, dist, other)


@numba.njit(cache=True, inline="always")
def _step(node, axis, sign, stride, bits):
    """Neighbour over an open edge, or -1. Edges out of the grid are never open, so flat indices cannot wrap."""
    if sign > 0:
        return node + stride[axis] if bits[node] >> axis & 1 else -1
    other = node - stride[axis]
    return other if other >= 0 and bits[other] >> axis & 1 else -1


@numba.njit(cache=True)
def _upwind(node, dist, known, stride, bits, h):
    """Arrival at `node` from its known neighbours: sum_i w_i (T - t_i)^2 = h^2, dropping late axes."""
    t0, t1, t2 = np.inf, np.inf, np.inf
    w0, w1, w2 = 0.0, 0.0, 0.0
    for axis in range(3):
        best, weight, first = np.inf, 0.0, np.inf
        for sign in (-1, 1):
            one = _step(node, axis, sign, stride, bits)
            if one < 0 or not known[one] or dist[one] >= first:
                continue
            first = dist[one]
            best, weight = first, 1.0
            two = _step(one, axis, sign, stride, bits)
            if two >= 0 and known[two] and dist[two] <= first:
                best, weight = (4.0 * first - dist[two]) / 3.0, 2.25
        if best < t0:
            t0, t1, t2, w0, w1, w2 = best, t0, t1, weight, w0, w1
        elif best < t1:
            t1, t2, w1, w2 = best, t1, weight, w1
        else:
            t2, w2 = best, weight
    a, b, c = w0, w0 * t0, w0 * t0 * t0 - h * h
    value = t0 + h / np.sqrt(w0)
    if t1 < value:
        a, b, c = a + w1, b + w1 * t1, c + w1 * t1 * t1
        value = (b + np.sqrt(max(b * b - a * c, 0.0))) / a
        if t2 < value:
            a, b, c = a + w2, b + w2 * t2, c + w2 * t2 * t2
            value = (b + np.sqrt(max(b * b - a * c, 0.0))) / a
    return value


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


def extend(
    geodesic: NDArray[np.float64], bits: NDArray[np.uint8], grid: Grid
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Finite distance (size,) [m] and its gradient (size, 3) at every node.

    Reachable nodes: the distance, differenced over open edges only (central where both are open), at most of length 1.
    Others (obstacles, pockets): distance to the nearest reachable node plus that node's value; -gradient points at it.
    """
    h, shape = grid.resolution_m, grid.shape
    reached = np.isfinite(geodesic)
    if not reached.any():
        return np.zeros(grid.size), np.zeros((grid.size, 3))
    gradient = _gradient(np.where(reached, geodesic, 0.0), bits, np.array(shape), h)
    value = geodesic.copy()
    if not reached.all():
        nearest = ndimage.distance_transform_edt(
            ~reached.reshape(shape), sampling=h, return_distances=False, return_indices=True
        )
        nearest = np.ravel_multi_index(tuple(np.asarray(nearest).reshape(3, -1)), shape)
        lost = np.flatnonzero(~reached)
        away = grid.points(lost) - grid.points(nearest[lost])
        gap = np.linalg.norm(away, axis=1)
        value[lost] = geodesic[nearest[lost]] + gap
        gradient[lost] = away / gap[:, None]
    return value, gradient


@numba.njit(cache=True, nogil=True)
def _gradient(dist, bits, shape, h):
    stride = np.array([shape[1] * shape[2], shape[2], 1])
    out = np.zeros((dist.size, 3))
    for node in range(dist.size):
        total = 0.0
        for axis in range(3):
            up, down = _step(node, axis, 1, stride, bits), _step(node, axis, -1, stride, bits)
            high = dist[up] if up >= 0 else dist[node]
            low = dist[down] if down >= 0 else dist[node]
            cells = (1 if up >= 0 else 0) + (1 if down >= 0 else 0)
            if cells > 0:
                out[node, axis] = (high - low) / (cells * h)
                total += out[node, axis] ** 2
        if total > 1.0:
            out[node] /= np.sqrt(total)
    return out
