"""Draws the pictures of docs/indoor.md: rooms in plan, scenes at an angle, and the made-up 3D-FRONT house.

python tools/draw_indoor.py [FOLDER]
"""

from __future__ import annotations

import re
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from numpy.typing import NDArray

from hotice.model import Obstacle, Scene
from hotice.model.generate.indoor import indoor_scenes
from hotice.model.generate.rooms import RECIPES, furnish
from hotice.model.generate.traversable import check_traversable
from hotice.model.importers.house_scenes import front3d_scenes
from hotice.replay.palette import CATEGORY_COLORS
from hotice.replay.solids import obstacle_triangles, outline, placed

FIXTURE = Path(__file__).parent.parent / "tests" / "model" / "importers" / "data" / "front3d"
LIGHT = np.array([-0.35, -0.55, 0.76])
CUT_M, WALL_CUT_M = 2.1, 0.25
"""Scenes are drawn up to this height, walls lower to leave the view free."""

Array = NDArray[np.float64]


def corners_of(obstacle: Obstacle) -> Array:
    """Triangles (F, 3, 3) in W."""
    vertices, faces = obstacle_triangles(obstacle)
    return placed(vertices, np.array(obstacle.position_m), np.array(obstacle.quaternion_wxyz))[faces]


def draw_plan(axes: Axes, obstacles: Sequence[Obstacle]) -> None:
    """Outlines from above."""
    for obstacle in sorted(obstacles, key=lambda o: o.position_m[2]):
        points = corners_of(obstacle).reshape(-1, 3)[:, :2]
        color = CATEGORY_COLORS[obstacle.category]
        alpha = 0.25 if obstacle.category == "overhead" else 0.6
        patch = PolyCollection([outline(points)], facecolor=(*to_rgb(color), alpha), edgecolor=color, linewidth=0.6)
        axes.add_collection(patch)
    axes.set_aspect("equal")
    axes.autoscale_view()
    axes.set_axis_off()


def draw_view(axes: Axes, scene: Scene, azimuth: float = -1.05, elevation: float = 0.75) -> None:
    """The scene inside its bounds at an angle, far triangles first, with the way through on its floor."""
    (c, s), (ce, se) = (np.cos(azimuth), np.sin(azimuth)), (np.cos(elevation), np.sin(elevation))
    right, up = np.array([-s, c, 0.0]), np.array([-c * se, -s * se, ce])
    toward = np.array([c * ce, s * ce, se])
    low, high = np.array(scene.bounds_m)
    parts, colors = [], []
    for obstacle in scene.obstacles:
        top = WALL_CUT_M if re.search("_wall($|inner|outer)", obstacle.name) else CUT_M
        corners = finely(clipped(corners_of(obstacle), low, np.array([*high[:2], top])))
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        facing = normal @ toward > 1e-12
        normal, corners = normal[facing], corners[facing]
        light = 0.62 + 0.38 * np.clip(normal @ LIGHT / np.linalg.norm(normal, axis=1), 0.0, 1.0)
        base = np.array(to_rgb(CATEGORY_COLORS[obstacle.category]))
        parts.append(corners)
        colors.append(base * light[:, None])
    floor = np.array([[low[0], low[1], 0], [high[0], low[1], 0], [high[0], high[1], 0], [low[0], high[1], 0]])
    axes.add_collection(
        PolyCollection([floor @ np.stack([right, up], axis=1)], facecolor="#eef1f4", edgecolor="#c5ccd4")
    )
    path = check_traversable(scene).path * [1.0, 1.0, 0.0]
    axes.plot(path @ right, path @ up, color="#16a34a", linewidth=2.0)
    corners, color = np.concatenate(parts), np.concatenate(colors)
    order = np.argsort(corners.mean(axis=1) @ toward)
    flat = corners[order] @ np.stack([right, up], axis=1)
    axes.add_collection(PolyCollection(list(flat), facecolors=color[order], edgecolors=color[order], linewidths=0.2))
    axes.set_aspect("equal")
    axes.autoscale_view()
    axes.set_axis_off()
    axes.set_title(scene.name, fontsize=8)


def clipped(corners: Array, low: Array, high: Array) -> Array:
    """The parts of triangles (F, 3, 3) within a box, as triangles."""
    done = []
    for polygon in corners:
        for axis, bound, sign in [(k, low[k], 1.0) for k in range(3)] + [(k, high[k], -1.0) for k in range(3)]:
            depth = sign * (polygon[:, axis] - bound)
            ring = []
            for i, p in enumerate(polygon):
                q, d, e = polygon[i - 1], depth[i], depth[i - 1]
                if (d >= 0.0) != (e >= 0.0):
                    ring.append(q + (p - q) * e / (e - d))
                if d >= 0.0:
                    ring.append(p)
            polygon = np.array(ring).reshape(-1, 3)
        done += [polygon[[0, i, i + 1]] for i in range(1, len(polygon) - 1)]
    return np.array(done).reshape(-1, 3, 3)


def finely(corners: Array, longest: float = 0.25) -> Array:
    """Triangles halved across their longest edge until none exceeds `longest` [m], so that they sort by depth."""
    done = []
    while len(corners):
        edge = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2)
        small = edge.max(axis=1) <= longest
        done.append(corners[small])
        corners, first = corners[~small], edge[~small].argmax(axis=1)
        a, b, c = (np.take_along_axis(corners, (first + k)[:, None, None] % 3, axis=1)[:, 0] for k in range(3))
        middle = 0.5 * (a + b)
        corners = np.concatenate([np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)])
    return np.concatenate(done) if done else corners


def save(figure: Figure, path: Path) -> None:
    """Writes the picture with a palette of 64 colours, which keeps it small."""
    from PIL import Image

    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    picture = Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3])
    picture.quantize(64, dither=Image.Dither.NONE).save(path, optimize=True)
    print(f"{path}: {path.stat().st_size / 1000:.0f} kB")


def main(folder: Path) -> None:
    """Writes the three pictures."""
    folder.mkdir(parents=True, exist_ok=True)
    figure = Figure(figsize=(11, 6.2), dpi=90, layout="constrained")
    for axes, kind in zip(figure.subplots(2, 3).ravel(), RECIPES, strict=True):
        room = furnish(kind, 0.6, np.random.default_rng(3))
        draw_plan(axes, room.obstacles)
        axes.set_title(f"{kind}, {room.length_m:.1f} x {room.width_m:.1f} m", fontsize=9)
    save(figure, folder / "indoor_rooms.png")

    figure = Figure(figsize=(11, 7.6), dpi=90, layout="constrained")
    for axes, scene in zip(figure.subplots(3, 4).ravel(), indoor_scenes(12).scenes, strict=True):
        draw_view(axes, scene)
    save(figure, folder / "indoor_scenes.png")

    figure = Figure(figsize=(11, 4.0), dpi=90, layout="constrained")
    with tempfile.TemporaryDirectory() as aside:
        found = front3d_scenes(
            FIXTURE / "house.json", FIXTURE / "models", aside, count=3, seed=1, size_m=(5.0, 4.0, 1.5)
        )
        for axes, scene in zip(figure.subplots(1, 3), found.scenes, strict=False):
            draw_view(axes, scene)
    save(figure, folder / "indoor_front3d.png")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent.parent / "docs" / "scenes")
