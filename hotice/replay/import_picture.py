"""Picture of what an import kept of a map: seen from above and from the side."""

from __future__ import annotations

import io
import math
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.patches import Circle, FancyArrow

from hotice.files import write_bytes
from hotice.model.importers.map_obstacles import FLOOR, KEPT, NOISE
from hotice.model.importers.scene_import import Imported
from hotice.replay.palette import CATEGORY_COLORS, GOAL_COLOR, SGF_COLOR
from hotice.replay.solids import obstacle_triangles, outline, placed
from hotice.task.rules import GOAL_M

DRAWN_POINTS = 60_000
FLOOR_COLOR, NOISE_COLOR = "#cbd5e1", "#dc2626"


def write_import_picture(imported: Imported, path: str | Path) -> Path:
    """Writes a PNG: kept points coloured by height, floor grey, noise red, obstacles as outlines, start and goal.

    Raises `OutputError` when `path` cannot be written.
    """
    low, high = np.array(imported.scene.bounds_m)
    width, depth, height = high - low
    figure = Figure(figsize=(12.0, 6.0 * max(depth, height) / width + 1.5), dpi=110, layout="constrained")
    FigureCanvasAgg(figure)
    top, side = figure.subplots(1, 2)
    for axes, plane in ((top, (0, 1)), (side, (0, 2))):
        _draw(axes, imported, plane)
    top.set_ylabel("y [m]")
    side.set_ylabel("z [m]")
    colors = figure.colorbar(top.collections[0], ax=[top, side], location="bottom", shrink=0.4, aspect=40)
    colors.set_label("height of what was kept [m]; grey: floor, red: noise and specks", fontsize=9)
    notes = "; ".join(
        f"{name}: {text}" for name, text in imported.notes.items() if name in ("floor", "crop", "obstacles")
    )
    figure.suptitle(f"{imported.scene.name}\n{notes}", fontsize=9)
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png")
    return write_bytes(path, buffer.getvalue())


def _draw(axes: Axes, imported: Imported, plane: tuple[int, int]) -> None:
    scene = imported.scene
    low, high = np.array(scene.bounds_m)
    index = np.arange(0, len(imported.points_W), math.ceil(max(len(imported.points_W), 1) / DRAWN_POINTS))
    points, group = imported.points_W[index], imported.group[index]
    kept = points[group == KEPT]
    if plane == (0, 1):
        kept = kept[np.argsort(kept[:, 2])]
    axes.scatter(*kept[:, plane].T, c=kept[:, 2], s=2, cmap="viridis", vmin=0.0, vmax=high[2], linewidths=0, zorder=3)
    for which, color, zorder in ((FLOOR, FLOOR_COLOR, 1), (NOISE, NOISE_COLOR, 6)):
        axes.scatter(*points[group == which][:, plane].T, c=color, s=2, linewidths=0, zorder=zorder)
    polygons, colors = [], []
    for obstacle in scene.obstacles:
        vertices, _ = obstacle_triangles(obstacle)
        corners = placed(vertices, np.array(obstacle.position_m), np.array(obstacle.quaternion_wxyz))
        polygons.append(outline(corners[:, plane]))
        colors.append(CATEGORY_COLORS[obstacle.category])
    axes.add_collection(PolyCollection(polygons, facecolor="none", edgecolor=colors, linewidth=0.7, zorder=5))
    if plane == (0, 1):
        x, y, yaw = scene.start
        axes.add_patch(
            FancyArrow(x, y, 0.3 * math.cos(yaw), 0.3 * math.sin(yaw), width=0.03, color=SGF_COLOR, zorder=8)
        )
        axes.add_patch(Circle(scene.goal, GOAL_M, fill=False, edgecolor=GOAL_COLOR, linewidth=2, zorder=8))
    else:
        for x, color in ((scene.start[0], SGF_COLOR), (scene.goal[0], GOAL_COLOR)):
            axes.plot([x, x], [0.0, 0.75], color=color, linewidth=2, marker="o", markevery=[1], zorder=8)
        axes.axhline(0.0, color="#475569", linewidth=1.0, zorder=4)
    axes.set_xlim(low[0], high[0])
    axes.set_ylim(low[plane[1]] - (0.05 if plane == (0, 2) else 0.0), high[plane[1]])
    axes.set_aspect("equal")
    axes.set_xlabel("x [m]")
    axes.grid(color="#e2e8f0", linewidth=0.5)
    axes.set_axisbelow(True)
