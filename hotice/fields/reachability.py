"""Reachability of the goal from the start, and the reason where there is no way."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from hotice.errors import UnreachableGoal
from hotice.fields.defaults import MARGIN_M, RESOLUTION_M
from hotice.fields.geodesic.fast_marching import solve_geodesic
from hotice.fields.grid import Grid
from hotice.fields.solids import Space
from hotice.model.scene import GOAL_HEIGHT_M, Scene

_REACH_CELLS = 2.0
_ROUNDING = 1e-9
MARGIN_STEP_M = 0.01


def check_reachable(scene: Scene, resolution_m: float = RESOLUTION_M, margin_m: float = MARGIN_M) -> None:
    """Raises `UnreachableGoal` unless free paths lead from the start at pelvis height to the goal, also at the margin.

    The message says what is in the way, which reachable point is nearest, and from which margin on the way opens.
    """
    grid = Grid.of(scene, resolution_m)
    space = Space.of(scene, grid)
    for margin in sorted({0.0, margin_m}):
        reached = np.isfinite(solve_geodesic(space, margin, scene.goal_W)[0])
        if not joins_start(scene, grid, reached):
            raise UnreachableGoal(explain(scene, grid, space, margin))


def joins_start(scene: Scene, grid: Grid, reached: NDArray[np.bool_]) -> bool:
    """Whether one of the `reached` nodes (size,) lies within two cells of the start at pelvis height."""
    start = (np.array([*scene.start[:2], GOAL_HEIGHT_M]) - grid.origin) / grid.resolution_m
    low = np.ceil(start - _REACH_CELLS - _ROUNDING).clip(0).astype(int)
    high = np.floor(start + _REACH_CELLS + _ROUNDING).clip(-1).astype(int) + 1
    return bool(reached.reshape(grid.shape)[tuple(map(slice, low, high))].any())


def explain(scene: Scene, grid: Grid, space: Space, margin_m: float) -> str:
    """Why start and goal are not joined at this margin."""
    start_W = np.array([*scene.start[:2], GOAL_HEIGHT_M])
    reason = "walls between start and goal leave no way"
    for what, p_W in (("goal", scene.goal_W), ("start", start_W)):
        for obstacle in scene.obstacles:
            gap = float(obstacle.signed_distance(p_W))
            if gap <= margin_m:
                reason = f"the {what} lies {100 * gap:.0f} cm from obstacle {obstacle.name!r}, within the margin"
    from_start, _ = solve_geodesic(space, margin_m, start_W)
    index = np.flatnonzero(np.isfinite(from_start))
    nearest = ""
    if len(index):
        p_W = grid.points(index)
        best = p_W[np.argmin(np.linalg.norm(p_W - scene.goal_W, axis=1))]
        nearest = f"; nearest reachable point is ({best[0]:.2f}, {best[1]:.2f}, {best[2]:.2f})"
    return f"scene {scene.name!r}: the goal is unreachable with margin {margin_m:g} m: {reason}{nearest}" + _opening(
        scene, grid, space, margin_m
    )


def _opening(scene: Scene, grid: Grid, space: Space, margin_m: float) -> str:
    """From which margin on the way opens, to the centimetre, by bisection."""
    low, high = 0, math.ceil(margin_m / MARGIN_STEP_M)
    if margin_m == 0.0 or not _opens(scene, grid, space, 0.0):
        return "; no margin opens a way"
    while high - low > 1:
        middle = (low + high) // 2
        if _opens(scene, grid, space, middle * MARGIN_STEP_M):
            low = middle
        else:
            high = middle
    return f"; the way opens at a margin of {low * MARGIN_STEP_M:.2f} m"


def _opens(scene: Scene, grid: Grid, space: Space, margin_m: float) -> bool:
    return joins_start(scene, grid, np.isfinite(solve_geodesic(space, margin_m, scene.goal_W)[0]))
