"""Exact signed distance on a grid, and which grid edges an obstacle blocks.

Grid convention: values sit at cell centres, `p_W = origin + index * resolution` with `origin = bounds_min +
resolution / 2` and `shape = floor(extent / resolution + 1/2)`; the defaults give 75 x 50 x 38. The floor is not an
obstacle. Distances are cut at `FAR_M`, which is also the value of a scene without obstacles.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hotice.fields.grid import Grid
from hotice.model.scene import Scene

FAR_M = 10.0
_CHUNK = 65_536
_TOUCH_M = 1e-6
"""Nodes closer than this count as inside."""


def distance_at(scene: Scene, p_W: NDArray[np.float64]) -> NDArray[np.float64]:
    """Exact signed distance to the scene's obstacles cut at FAR_M, (n, 3) in W [m] -> (n,) [m]."""
    result = np.full(len(p_W), FAR_M)
    for start in range(0, len(p_W), _CHUNK):
        part = slice(start, start + _CHUNK)
        np.minimum(result[part], scene.signed_distance(p_W[part]), out=result[part])
    return result


def grid_distance(scene: Scene, grid: Grid) -> NDArray[np.float64]:
    """`distance_at` all nodes, (size,) [m]."""
    return distance_at(scene, grid.points())


def segments_blocked(
    scene: Scene, a_W: NDArray[np.float64], b_W: NDArray[np.float64], margin_m: float, steps: int = 32
) -> NDArray[np.bool_]:
    """Whether segments a-b, (n, 3) each, meet the inflated obstacles, by sphere tracing; grazing counts as yes."""
    span = b_W - a_W
    length = np.linalg.norm(span, axis=1)
    direction = span / np.maximum(length, 1e-12)[:, None]
    blocked = np.ones(len(a_W), dtype=bool)
    active = np.arange(len(a_W))
    t = np.zeros(len(a_W))
    for _ in range(steps):
        s = distance_at(scene, a_W[active] + t[active, None] * direction[active]) - margin_m
        t[active] += s
        hit, past = s <= _TOUCH_M, t[active] >= length[active]
        blocked[active[past & ~hit]] = False
        active = active[~hit & ~past]
        if not len(active):
            break
    return blocked


def open_edges(scene: Scene, grid: Grid, sdf: NDArray[np.float64], margin_m: float) -> NDArray[np.uint8]:
    """Bits 1, 2, 4 of each node: the edge to its +x, +y, +z neighbour is free of inflated obstacles, (size,).

    Testing edges, not only nodes, keeps plates thinner than a cell closed. `sdf`: raw distances at the nodes.
    """
    s = (sdf - margin_m).reshape(grid.shape)
    free = s > _TOUCH_M
    bits = np.zeros(grid.shape, dtype=np.uint8)
    flat = np.arange(grid.size).reshape(grid.shape)
    for axis in range(3):
        lower, upper = [slice(None)] * 3, [slice(None)] * 3
        lower[axis], upper[axis] = slice(None, -1), slice(1, None)
        lo, up = tuple(lower), tuple(upper)
        both = free[lo] & free[up]
        doubtful = both & (s[lo] + s[up] < grid.resolution_m)
        if doubtful.any():
            a, b = grid.points(flat[lo][doubtful]), grid.points(flat[up][doubtful])
            both[doubtful] = ~segments_blocked(scene, a, b, margin_m)
        bits[lo] |= (both << axis).astype(np.uint8)
    return bits.reshape(-1)
