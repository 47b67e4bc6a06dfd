"""The first families: one obstacle or pair each, in simple geometry, graded from easy to hard (all numbers are ours).

Policies were trained and scored on these scenes, so their geometry is fixed for good.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from hotice.model.generate.pieces import (
    ACROSS,
    CEILING_M,
    HALF_WIDTH_M,
    Obstacles,
    either_side,
    grade,
    obstacle,
    within,
)
from hotice.model.geometry.shapes import BoxShape, CylinderShape, SphereShape
from hotice.model.scene import Scene

Family = Callable[[float, float, np.random.Generator], Obstacles]


def open_floor(name: str, difficulty: float, rng: np.random.Generator) -> Scene:
    """No obstacles; the goal 1 to 2.2 m away, within ± 35 degrees. Bounds widen where it needs them."""
    distance, bearing = grade(difficulty, 1.0, 2.2), math.radians(rng.uniform(-35.0, 35.0))
    goal = (distance * math.cos(bearing), distance * math.sin(bearing))
    half_width = max(HALF_WIDTH_M, abs(goal[1]) + 0.5)
    return Scene(name, ((-0.5, -half_width, 0.0), (2.5, half_width, 1.5)), goal=goal)


def _pipe(difficulty: float, x: float, rng: np.random.Generator) -> Obstacles:
    """A pipe on the ground across the path, radius 1 to 5 cm."""
    radius = grade(difficulty, 0.01, 0.05)
    x = within(x + rng.uniform(-0.1, 0.1), 0.1)
    return [obstacle("pipe", "ground", CylinderShape(radius, 2 * HALF_WIDTH_M), x, 0.0, radius, quat=ACROSS)]


def _step(difficulty: float, x: float, rng: np.random.Generator) -> Obstacles:
    """A bar on the ground across the path, 4 to 8 cm long, 1 to 10 cm high."""
    length, height = rng.uniform(0.04, 0.08), grade(difficulty, 0.01, 0.10)
    x = within(x + rng.uniform(-0.1, 0.1), 0.1)
    return [obstacle("step", "ground", BoxShape((length, 2 * HALF_WIDTH_M, height)), x, 0.0, 0.5 * height)]


def _gap(difficulty: float, x: float, rng: np.random.Generator) -> Obstacles:
    """A doorway of two full-height boxes, 1.05 to 0.70 m wide, up to 15 cm off the centre line."""
    width, offset, length = grade(difficulty, 1.05, 0.70), rng.uniform(-0.15, 0.15), rng.uniform(0.1, 0.4)
    x = within(x, 0.5 * length)
    obstacles = []
    for name, side in (("left_wall", 1.0), ("right_wall", -1.0)):
        inner = side * offset + 0.5 * width  # distance from the centre line to this wall
        size = (length, HALF_WIDTH_M - inner, 1.5)
        obstacles.append(obstacle(name, "side", BoxShape(size), x, side * 0.5 * (HALF_WIDTH_M + inner), 0.75))
    return obstacles


def pillars(difficulty: float, rng: np.random.Generator) -> Obstacles:
    """Two or three pillars left and right in turn; the free width between neighbours is 0.75 to 0.65 m."""
    free, side = grade(difficulty, 0.75, 0.65), either_side(rng)
    number = int(rng.integers(2, 4))
    radius = float(rng.uniform(0.05, 0.12))
    spacing = {2: 0.58, 3: 0.46}[number]
    middle = 1.2 + rng.uniform(-0.03, 0.03)
    aside = 0.5 * math.sqrt((free + 2 * radius) ** 2 - spacing**2)
    obstacles = []
    for i in range(number):
        x, y = middle + (i - 0.5 * (number - 1)) * spacing, side * (-1) ** i * aside
        obstacles.append(obstacle(f"pillar_{i + 1}", "side", CylinderShape(radius, 1.5), x, y, 0.75))
    return obstacles


def _table_edge(difficulty: float, x: float, rng: np.random.Generator) -> Obstacles:
    """A table from one side: top 70 to 95 cm high and 4 cm thick, its edge 0.45 to 0.20 m from the centre line."""
    edge, side = grade(difficulty, 0.45, 0.20), either_side(rng)
    length, height, thick = rng.uniform(0.4, 0.6), rng.uniform(0.70, 0.95), 0.04
    x, width, leg = within(x, 0.5 * length), HALF_WIDTH_M - edge, 0.05
    top = BoxShape((length, width, thick))
    obstacles = [obstacle("table_top", "side", top, x, side * (edge + 0.5 * width), height - 0.5 * thick)]
    for i, end in enumerate((-1.0, 1.0)):
        at = x + end * 0.5 * (length - leg), side * (HALF_WIDTH_M - 0.5 * leg)
        shape = BoxShape((leg, leg, height - thick))
        obstacles.append(obstacle(f"table_leg_{i + 1}", "side", shape, *at, 0.5 * (height - thick)))
    return obstacles


def _beam(difficulty: float, x: float, rng: np.random.Generator) -> Obstacles:
    """A beam across at head height, 10 to 30 cm long, its underside 1.36 to 1.05 m high."""
    under, length = grade(difficulty, 1.36, 1.05), rng.uniform(0.1, 0.3)
    height = CEILING_M - under
    shape = BoxShape((length, 2 * HALF_WIDTH_M, height))
    return [obstacle("beam", "overhead", shape, within(x, 0.5 * length), 0.0, under + 0.5 * height)]


def _hanging(difficulty: float, x: float, rng: np.random.Generator) -> Obstacles:
    """A lamp on a cord: ball or short cylinder, lower end 1.35 to 1.0 m high, up to 0.3 m off the centre line."""
    low, radius = grade(difficulty, 1.35, 1.0), rng.uniform(0.10, 0.18)
    height = float(rng.choice([2 * radius, rng.uniform(0.12, 0.25)]))
    shape = SphereShape(radius) if height == 2 * radius else CylinderShape(radius, height)
    x, y = within(x, radius), rng.uniform(-0.3, 0.3)
    obstacles = [obstacle("lamp", "overhead", shape, x, y, low + 0.5 * height)]
    cord = CEILING_M - (low + height)
    if cord > 0.01:
        obstacles.append(obstacle("cord", "overhead", CylinderShape(0.015, cord), x, y, CEILING_M - 0.5 * cord))
    return obstacles


SINGLE: dict[str, Family] = {
    "pipe": _pipe,
    "step": _step,
    "gap": _gap,
    "table_edge": _table_edge,
    "beam": _beam,
    "hanging": _hanging,
}
"""Families of one obstacle (or pair) at a given place along x; `combo` joins two of them."""


def combo(difficulty: float, rng: np.random.Generator) -> Obstacles:
    """Two different single families of medium difficulty, one behind the other."""
    first, second = (list(SINGLE)[i] for i in rng.choice(len(SINGLE), 2, replace=False))
    medium = 0.3 + 0.4 * difficulty
    return SINGLE[first](medium, 0.75, rng) + SINGLE[second](medium, 1.4, rng)
