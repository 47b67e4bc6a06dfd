"""Common pieces of scene generators: places for obstacles, grading, and the usual obstacles."""

from __future__ import annotations

import math

import numpy as np

from hotice.model.frames import quat_from_yaw
from hotice.model.geometry.shapes import BoxShape, CylinderShape, Shape, SphereShape
from hotice.model.scene import Obstacle

NEAREST_M, FARTHEST_M = 0.60, 1.75
"""Along x, what is near the centre line stands ahead of a box held at the start and behind the robot at the goal."""
HALF_WIDTH_M, CEILING_M = 1.0, 1.6
ACROSS = (math.sqrt(0.5), math.sqrt(0.5), 0.0, 0.0)
"""Orientation wxyz that lays a cylinder along y."""

Obstacles = list[Obstacle]


def grade(difficulty: float, easy: float, hard: float) -> float:
    """From `easy` to `hard` as the difficulty goes from 0 to 1."""
    return easy + difficulty * (hard - easy)


def either_side(rng: np.random.Generator) -> float:
    """1 (left) or -1 (right)."""
    return float(rng.choice([-1.0, 1.0]))


def within(x: float, half: float) -> float:
    """X moved so that x ± half keeps clear of what is held at the start and of the robot at the goal."""
    return min(max(x, NEAREST_M + half), FARTHEST_M - half)


def obstacle(name: str, category: str, shape: Shape, *position: float, quat=(1.0, 0.0, 0.0, 0.0)) -> Obstacle:
    """An obstacle at x, y, z [m]; `quat` wxyz."""
    return Obstacle(name, category, shape, position, quat)  # type: ignore[arg-type]


def ground_bar(name: str, x: float, length: float, height: float, yaw: float = 0.0, width: float = 2.4) -> Obstacle:
    """A bar on the floor across the path, turned by `yaw` about its middle."""
    quat = tuple(quat_from_yaw(yaw).tolist())
    return obstacle(name, "ground", BoxShape((length, width, height)), x, 0.0, 0.5 * height, quat=quat)


def ground_pipe(name: str, x: float, radius: float, height: float) -> Obstacle:
    """A pipe across the path whose top is `height` high; the rest of a thicker one lies below the floor."""
    return obstacle(name, "ground", CylinderShape(radius, 2 * HALF_WIDTH_M), x, 0.0, height - radius, quat=ACROSS)


def wall(name: str, x: float, length: float, y_from: float, y_to: float, height: float = 1.5) -> Obstacle:
    """A box that stands on the floor between two y."""
    size = (length, abs(y_to - y_from), height)
    return obstacle(name, "side", BoxShape(size), x, 0.5 * (y_from + y_to), 0.5 * height)


def overhead_beam(name: str, x: float, length: float, under: float, y_from: float, y_to: float) -> Obstacle:
    """A box from `under` up to the ceiling."""
    size = (length, abs(y_to - y_from), CEILING_M - under)
    return obstacle(name, "overhead", BoxShape(size), x, 0.5 * (y_from + y_to), 0.5 * (CEILING_M + under))


def lamp(name: str, x: float, y: float, radius: float, low: float, height: float | None = None) -> Obstacles:
    """A ball, or a cylinder of a `height`, hanging on a cord; `low` is its lower end."""
    shape = SphereShape(radius) if height is None else CylinderShape(radius, height)
    top = low + (2 * radius if height is None else height)
    hung = [obstacle(name, "overhead", shape, x, y, 0.5 * (low + top))]
    if top < CEILING_M - 0.01:
        cord = CylinderShape(0.015, CEILING_M - top)
        hung.append(obstacle(f"{name}_cord", "overhead", cord, x, y, 0.5 * (CEILING_M + top)))
    return hung
