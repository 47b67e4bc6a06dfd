"""Grids of many scenes in three flat arrays, laid out (scene, x, y, z, channel), each scene with its own extent."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hotice.fields.extension import extend
from hotice.fields.geodesic import solve_geodesic
from hotice.fields.grid import Grid
from hotice.fields.solids import Space
from hotice.model.scene import Scene


@dataclass(frozen=True)
class Volumes:
    """Node values of S scenes, M nodes in all, on grids of one resolution.

    `origin` (S, 3) [m] first nodes, `shape` (S, 3), `offset` (S,) first flat index of each scene; `sdf` (M,) [m] raw
    signed distance; `geo` one (M, 4) array per margin: finite geodesic distance [m] and its gradient.
    """

    resolution_m: float
    origin: NDArray[np.float32]
    shape: NDArray[np.int64]
    offset: NDArray[np.int64]
    sdf: NDArray[np.float32]
    geo: tuple[NDArray[np.float32], ...]

    @property
    def nbytes(self) -> int:
        """Memory of the node values."""
        return self.sdf.nbytes + sum(g.nbytes for g in self.geo)


@dataclass(frozen=True)
class SceneNodes:
    """Node values of one scene: `sdf` (size,), and per margin `geo` (size, 4) and `reached` (size,)."""

    grid: Grid
    sdf: NDArray[np.float32]
    geo: tuple[NDArray[np.float32], ...]
    reached: tuple[NDArray[np.bool_], ...]


def solve_scene(scene: Scene, resolution_m: float, margins_m: tuple[float, ...]) -> SceneNodes:
    """Distances and geodesics of one scene for each inflation margin; equal margins are solved once."""
    grid = Grid.of(scene, resolution_m)
    space = Space.of(scene, grid)
    done: dict[float, tuple[NDArray[np.float32], NDArray[np.bool_]]] = {}
    for margin_m in margins_m:
        if margin_m not in done:
            geodesic, slope = solve_geodesic(space, margin_m, scene.goal_W)
            value, gradient = extend(geodesic, slope, grid)
            done[margin_m] = (np.column_stack([value, gradient]).astype(np.float32), np.isfinite(geodesic))
    geo, reached = zip(*(done[m] for m in margins_m), strict=True)
    return SceneNodes(grid, space.sdf.astype(np.float32), geo, reached)


def stack(scenes: list[SceneNodes]) -> Volumes:
    """One `Volumes` of all scenes, which share resolution and number of margins."""
    sizes = np.array([s.grid.size for s in scenes], dtype=np.int64)
    return Volumes(
        resolution_m=scenes[0].grid.resolution_m,
        origin=np.array([s.grid.origin for s in scenes], dtype=np.float32),
        shape=np.array([s.grid.shape for s in scenes], dtype=np.int64),
        offset=np.concatenate([[0], np.cumsum(sizes)[:-1]]).astype(np.int64),
        sdf=np.concatenate([s.sdf for s in scenes]),
        geo=tuple(np.concatenate(g) for g in zip(*(s.geo for s in scenes), strict=True)),
    )
