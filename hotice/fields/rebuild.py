"""Node values of a scene that changes: what a change cannot touch is taken from the build before, bit for bit."""

from __future__ import annotations

import numpy as np

from hotice.fields.geodesic.changes import changed_boxes, changed_obstacles
from hotice.fields.geodesic.fast_marching import solve_again
from hotice.fields.geodesic.memory import Searches, no_searches
from hotice.fields.grid import Grid
from hotice.fields.solids import Space
from hotice.fields.volumes import Geodesic, SceneNodes, solve_space
from hotice.model.scene import Obstacle, Scene


class Rebuilder:
    """Builds node values again and again, of one scene after another: those of `hotice.fields.volumes.solve_scene`.

    Scenes of the same bounds have most in common where few obstacles differ; others are built from nothing.

    Args:
        resolution_m: of the grid [m]; margins_m: inflations of the fields [m]; threads: that share the work.
    """

    def __init__(self, resolution_m: float, margins_m: tuple[float, ...], threads: int = 1) -> None:
        self._resolution_m, self._margins_m, self._threads = resolution_m, margins_m, threads
        self._bounds_m: object = None
        self._obstacles: tuple[Obstacle, ...] = ()
        self._space: Space | None = None
        self._searches: dict[float, Searches] = {}

    def solve(self, scene: Scene) -> SceneNodes:
        """Node values of a scene. Raises `InvalidScene` for a mesh that cannot be used: the next build is whole."""
        grid, before, last = Grid.of(scene, self._resolution_m), self._space, self._obstacles
        changed = changed_obstacles(last, scene.obstacles) if scene.bounds_m == self._bounds_m else None
        # whatever ends this build early, nothing is built on what it has begun to overwrite
        self._space = None
        empty = Space.empty(scene, grid)
        if before is not None and changed is not None:
            differs = set(changed)
            then, now = (np.array([o in differs for o in each], np.bool_) for each in (last, scene.obstacles))
            stale = before.blocks_near(then) | empty.blocks_near(now)
            space = empty.filled(before.sdf.copy(), stale, self._threads)
        else:
            space = empty.filled(np.empty(grid.size), None, self._threads)
            changed, self._searches = [], {}

        def geodesic(margin_m: float) -> Geodesic:
            boxes = changed_boxes(changed, margin_m, grid.resolution_m)
            searches = self._searches.pop(margin_m, None) or no_searches(grid.size)
            # what a lone obstacle hides is all behind it: wherever it goes, no search would be found again
            alone = len(scene.obstacles) < 2
            searches = no_searches() if alone else searches
            distance, slope, searches = solve_again(space, margin_m, scene.goal_W, searches, boxes)
            if not alone:
                self._searches[margin_m] = searches
            return distance, slope

        nodes = solve_space(space, grid, self._margins_m, geodesic, self._threads)
        self._bounds_m, self._obstacles, self._space = scene.bounds_m, scene.obstacles, space
        return nodes
