"""Plans: a scene from above, with a way through it."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.patches import Circle, FancyArrow
from numpy.typing import NDArray

from hotice.model.scene import Scene
from hotice.replay.palette import CATEGORY_COLORS, GOAL_COLOR, ROOT_COLOR
from hotice.replay.solids import course_of, obstacle_geom, obstacle_triangles, outline, placed
from hotice.task.rules import GOAL_M

_ALPHA = {"ground": 0.85, "side": 0.75, "overhead": 0.35}
"""Opacity of obstacles by category: below one that hangs overhead the floor is seen."""


def draw_map(axes: Axes, scene: Scene, path_W: NDArray[np.float64] | None = None) -> None:
    """Draws obstacles by category, start, goal and a path (n, 2 or more; x, y first) in W [m].

    What moves stands where it is at first, its way a dotted line.
    """
    for obstacle in sorted(scene.obstacles, key=lambda o: ("ground", "side", "overhead").index(o.category)):
        vertices, faces = obstacle_triangles(obstacle)
        corners = placed(vertices, np.array(obstacle.position_m), np.array(obstacle.quaternion_wxyz))[:, :2]
        hollow = obstacle_geom(obstacle)[0] == "mesh"
        color = CATEGORY_COLORS[obstacle.category]
        axes.add_collection(
            PolyCollection(
                list(corners[faces]) if hollow else [outline(corners)],
                facecolor=color,
                alpha=_ALPHA[obstacle.category],
                edgecolor="none" if hollow else color,
                linewidth=0.8,
            )
        )
        if obstacle.motion is not None:
            axes.plot(*course_of(obstacle)[:, :2].T, color=color, linewidth=1.2, linestyle=":", zorder=4)
    if path_W is not None:
        axes.plot(*np.asarray(path_W)[:, :2].T, color=ROOT_COLOR, linewidth=1.6, zorder=5)
    x, y, yaw = scene.start
    axes.add_patch(FancyArrow(x, y, 0.2 * math.cos(yaw), 0.2 * math.sin(yaw), width=0.03, color=ROOT_COLOR, zorder=6))
    axes.add_patch(Circle(scene.goal, GOAL_M, fill=False, edgecolor=GOAL_COLOR, linewidth=2, zorder=6))
    low, high = scene.bounds_m
    axes.set_xlim(low[0], high[0])
    axes.set_ylim(low[1], high[1])
    axes.set_aspect("equal")
    axes.set_facecolor("#f6f8fa")
    axes.set_xlabel("x [m]")
