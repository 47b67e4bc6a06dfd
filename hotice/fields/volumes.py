"""Grids of many scenes in flat arrays, laid out (scene, x, y, z, channel), each scene with its own extent.

A node takes 20 bytes, so 2,000 scenes of the default grid fit in 5.7 GB: the signed distance as float32; geodesic
distance and gradient as int16, in steps of the scene's largest distance / 32767 (0.1 mm at 3 m, so half of that is the
error) and of 1 / 32767 (so the attractive force is wrong by less than 2e-5 m/s).
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from hotice.compiled import compiled
from hotice.fields.geodesic.extension import extend
from hotice.fields.geodesic.fast_marching import solve_geodesic
from hotice.fields.grid import Grid
from hotice.fields.solids import Space
from hotice.model.scene import Scene

Geodesic: TypeAlias = tuple[NDArray[np.float64], NDArray[np.float64]]
SLOPE_STEP = 1.0 / 32767
NODE_BYTES = 4 + 2 * 8


@dataclass(frozen=True)
class Volumes:
    """Node values of S scenes, M nodes in all, on grids of one resolution.

    `origin` (S, 3) [m] first nodes, `shape` (S, 3), `offset` (S,) first flat index of each scene; `sdf` (M,) [m] raw
    signed distance; `geo` one (M, 4) array per margin: finite geodesic distance in steps of `step` (S, margins) [m] and
    its gradient in steps of `SLOPE_STEP`.
    """

    resolution_m: float
    origin: NDArray[np.float32]
    shape: NDArray[np.int64]
    offset: NDArray[np.int64]
    step: NDArray[np.float32]
    sdf: NDArray[np.float32]
    geo: tuple[NDArray[np.int16], ...]

    @property
    def nbytes(self) -> int:
        """Memory of the node values."""
        return self.sdf.nbytes + sum(g.nbytes for g in self.geo)


@dataclass(frozen=True)
class SceneNodes:
    """Node values of one scene: `sdf` (size,), and per margin `geo` (size, 4), its `step` and `reached` (size,)."""

    grid: Grid
    sdf: NDArray[np.float32]
    geo: tuple[NDArray[np.int16], ...]
    step: tuple[float, ...]
    reached: tuple[NDArray[np.bool_], ...]


def pack(value: NDArray[np.floating], gradient: NDArray[np.floating]) -> tuple[NDArray[np.int16], float]:
    """Distances (n,) >= 0 [m] and gradients (n, 3) as int16 (n, 4), and the step of the distances [m]."""
    step = max(float(value.max()), 1e-3) / 32767
    return _rounded(value, gradient, step), step


@compiled(nogil=True)
def _rounded(value, gradient, step):
    packed = np.empty((len(value), 4), np.int16)
    for n in range(len(value)):
        packed[n, 0] = np.rint(value[n] / step)
        for axis in range(3):
            packed[n, 1 + axis] = np.rint(gradient[n, axis] / SLOPE_STEP)
    return packed


def solve_scene(scene: Scene, resolution_m: float, margins_m: tuple[float, ...], threads: int = 1) -> SceneNodes:
    """Distances and geodesics of one scene for each inflation margin; equal margins are solved once."""
    grid = Grid.of(scene, resolution_m)
    space = Space.of(scene, grid, threads)
    return solve_space(space, grid, margins_m, lambda margin_m: solve_geodesic(space, margin_m, scene.goal_W), threads)


def solve_space(
    space: Space, grid: Grid, margins_m: tuple[float, ...], geodesic: Callable[[float], Geodesic], threads: int
) -> SceneNodes:
    """`solve_scene` of a filled space; `geodesic` of a margin: distance (size,) [m] and gradient (size, 3)."""

    def solve(margin_m: float) -> tuple[NDArray[np.int16], float, NDArray[np.bool_]]:
        distance, slope = geodesic(margin_m)
        reached = np.isfinite(distance)
        return *pack(*extend(distance, slope, grid)), reached

    different = sorted(set(margins_m))
    if threads > 1:
        with ThreadPoolExecutor(threads) as pool:
            done = dict(zip(different, pool.map(solve, different), strict=True))
    else:
        done = {margin_m: solve(margin_m) for margin_m in different}
    geo, step, reached = zip(*(done[m] for m in margins_m), strict=True)
    return SceneNodes(grid, space.sdf.astype(np.float32), geo, step, reached)


def stack(scenes: list[SceneNodes]) -> Volumes:
    """One `Volumes` of all scenes, which share resolution and number of margins."""
    sdf = np.concatenate([s.sdf for s in scenes])
    geo = tuple(np.concatenate(g) for g in zip(*(s.geo for s in scenes), strict=True))
    return arrange([s.grid for s in scenes], [s.step for s in scenes], sdf, geo)


def arrange(
    grids: list[Grid], steps: list[tuple[float, ...]], sdf: NDArray[np.float32], geo: tuple[NDArray[np.int16], ...]
) -> Volumes:
    """`Volumes` of node values that lie one scene after another."""
    sizes = np.array([g.size for g in grids], dtype=np.int64)
    return Volumes(
        resolution_m=grids[0].resolution_m,
        origin=np.array([g.origin for g in grids], dtype=np.float32),
        shape=np.array([g.shape for g in grids], dtype=np.int64),
        offset=np.concatenate([[0], np.cumsum(sizes)[:-1]]).astype(np.int64),
        step=np.array(steps, dtype=np.float32),
        sdf=sdf,
        geo=geo,
    )
