"""Typical obstacles of homes and workshops, graded from easy to hard, larger and more varied than `graded`.

A family maps a difficulty in 0..1 and a generator to obstacles between start (0, 0) and goal (2, 0). What decides the
difficulty follows the number alone; places, offsets and shapes are drawn. `families` keeps a draw only when a robot
with its load gets through (`traversable`), and draws again otherwise. All numbers are ours; those of the paper's scenes
are not published.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from hotice.model.generate.pieces import (
    FARTHEST_M,
    HALF_WIDTH_M,
    NEAREST_M,
    Obstacles,
    either_side,
    grade,
    ground_bar,
    ground_pipe,
    lamp,
    obstacle,
    overhead_beam,
    wall,
    within,
)
from hotice.model.geometry.shapes import BoxShape, CylinderShape

Typical = Callable[[float, np.random.Generator], Obstacles]
DEPTH_M = 0.20
"""Floor that a ground obstacle takes along the path at most, so that one stride goes over it."""
FOOTING_M = 0.36
"""Free floor between two ground obstacles, for both feet."""


def _a_pipe(name: str, x: float, height: float, rng: np.random.Generator) -> Obstacles:
    """A pipe of radius 3 to 15 cm, `height` high; one that would be higher lies partly below the floor."""
    half = 0.5 * DEPTH_M
    thickest = half if height >= half else (half**2 + height**2) / (2 * height)  # where it takes DEPTH_M of the floor
    return [ground_pipe(name, x, float(rng.uniform(max(0.5 * height, 0.03), min(thickest, 0.15))), height)]


def _a_step(name: str, x: float, height: float, rng: np.random.Generator) -> Obstacles:
    return [ground_bar(name, x, float(rng.uniform(0.05, 0.16)), height, float(rng.uniform(-0.15, 0.15)))]


def _somewhere(rng: np.random.Generator, half: float) -> float:
    return within(float(rng.uniform(NEAREST_M, FARTHEST_M)), half)


def one_pipe(difficulty: float, rng: np.random.Generator) -> Obstacles:
    """A pipe across, 3 to 15 cm high, radius 3 to 15 cm (the thick ones half sunk)."""
    return _a_pipe("pipe", _somewhere(rng, 0.1), grade(difficulty, 0.03, 0.15), rng)


def two_pipes(difficulty: float, rng: np.random.Generator) -> Obstacles:
    """Two pipes with a foothold between them, each 3 to 12 cm high."""
    return _twice(_a_pipe, "pipe", grade(difficulty, 0.03, 0.12), rng)


def one_step(difficulty: float, rng: np.random.Generator) -> Obstacles:
    """A bar across, 3 to 15 cm high, 5 to 16 cm deep, up to 9 degrees askew."""
    return _a_step("step", _somewhere(rng, 0.25), grade(difficulty, 0.03, 0.15), rng)


def two_steps(difficulty: float, rng: np.random.Generator) -> Obstacles:
    """Two bars with a foothold between them, each 3 to 12 cm high."""
    return _twice(_a_step, "step", grade(difficulty, 0.03, 0.12), rng)


def _twice(make: Callable, name: str, height: float, rng: np.random.Generator) -> Obstacles:
    apart = float(rng.uniform(DEPTH_M + FOOTING_M, 0.75))
    middle = within(float(rng.uniform(1.0, 1.4)), 0.5 * apart + 0.1)
    heights = rng.permutation([height, height * float(rng.uniform(0.6, 1.0))])
    ends = zip((-0.5, 0.5), heights, strict=True)
    return [o for i, (end, h) in enumerate(ends) for o in make(f"{name}_{i + 1}", middle + end * apart, float(h), rng)]


def beam_across(difficulty: float, rng: np.random.Generator) -> Obstacles:
    """A beam across, its underside 1.30 to 1.00 m high, 10 to 40 cm long; every third ends above the lane's middle."""
    length = float(rng.uniform(0.1, 0.4))
    side, inner = either_side(rng), HALF_WIDTH_M if rng.random() < 2 / 3 else float(rng.uniform(0.0, 0.2))
    x, under = _somewhere(rng, 0.5 * length), grade(difficulty, 1.30, 1.00)
    return [overhead_beam("beam", x, length, under, -side * inner, side * HALF_WIDTH_M)]


def side_gap(difficulty: float, rng: np.random.Generator) -> Obstacles:
    """A passage 1.0 to 0.6 m wide, 10 to 60 cm long, up to 0.3 m aside; every other one has a sill of 3 to 8 cm."""
    return _gap(grade(difficulty, 1.0, 0.60), float(rng.uniform(-0.3, 0.3)), rng)


def narrow_gap(difficulty: float, rng: np.random.Generator) -> Obstacles:
    """A passage 0.60 to 0.50 m wide: judged with a load of 20 cm, since hands at a 40 cm box are 53 cm apart."""
    return _gap(grade(difficulty, 0.60, 0.50), float(rng.uniform(-0.15, 0.15)), rng)


def _gap(width: float, offset: float, rng: np.random.Generator) -> Obstacles:
    length, sill = float(rng.uniform(0.1, 0.6)), bool(rng.random() < 0.5)
    x = _somewhere(rng, 0.5 * length)
    found = [
        wall("left_wall", x, length, offset + 0.5 * width, HALF_WIDTH_M),
        wall("right_wall", x, length, offset - 0.5 * width, -HALF_WIDTH_M),
    ]
    if sill:
        found.append(ground_bar("sill", x, float(rng.uniform(0.04, 0.1)), float(rng.uniform(0.03, 0.08))))
    return found


def slalom(difficulty: float, rng: np.random.Generator) -> Obstacles:
    """Three round or square pillars left and right in turn; 0.85 to 0.66 m free between neighbours."""
    free, side, spacing = grade(difficulty, 0.85, 0.66), either_side(rng), float(rng.uniform(0.42, 0.5))
    radius = rng.uniform(0.05, 0.10, 3)
    found, y = [], -0.5 * math.sqrt((free + 2 * 0.08) ** 2 - spacing**2) + rng.uniform(-0.04, 0.04)
    for i, r in enumerate(radius.tolist()):
        shape = CylinderShape(r, 1.5) if rng.random() < 0.6 else BoxShape((2 * r, 2 * r, 1.5))
        found.append(obstacle(f"pillar_{i + 1}", "side", shape, 1.18 + (i - 1) * spacing, side * (-1) ** i * y, 0.75))
    return found


def table(difficulty: float, rng: np.random.Generator) -> Obstacles:
    """Table tops, 0.68 to 1.0 m high and 4 to 10 cm thick, that only what is carried meets.

    From one side to 0.30 .. 0.08 m from the centre line, or from both sides with 0.70 .. 0.48 m between them.
    """
    length, thick = float(rng.uniform(0.3, 0.7)), float(rng.uniform(0.04, 0.10))
    x, top = _somewhere(rng, 0.5 * length), float(rng.uniform(0.68, 1.0))
    side = either_side(rng)
    if rng.random() < 0.5:
        return _table("table", x, length, top, thick, side, grade(difficulty, 0.30, 0.08))
    edge, offset = 0.5 * grade(difficulty, 0.70, 0.48), float(rng.uniform(-0.1, 0.1))
    found = _table("table", x, length, top, thick, side, edge + side * offset)
    return found + _table("shelf", x, length, top, thick, -side, edge - side * offset)


def _table(name: str, x: float, length: float, top: float, thick: float, side: float, edge: float) -> Obstacles:
    width, leg = HALF_WIDTH_M - edge, 0.05
    plate = BoxShape((length, width, thick))
    found = [obstacle(f"{name}_top", "side", plate, x, side * (edge + 0.5 * width), top - 0.5 * thick)]
    for i, end in enumerate((-1.0, 1.0)):
        post = BoxShape((leg, leg, top - thick))
        at = x + end * 0.5 * (length - leg), side * (HALF_WIDTH_M - 0.5 * leg), 0.5 * (top - thick)
        found.append(obstacle(f"{name}_leg_{i + 1}", "side", post, *at))
    return found


def lamps(difficulty: float, rng: np.random.Generator) -> Obstacles:
    """One to three lamps on cords, their lower ends 1.30 to 0.95 m high, within 0.35 m of the centre line."""
    number = int(rng.integers(1, 4))
    found: Obstacles = []
    for i, x in enumerate(np.linspace(0.8, 1.55, number) if number > 1 else [float(rng.uniform(0.8, 1.5))]):
        radius, height = float(rng.uniform(0.08, 0.16)), float(rng.uniform(0.1, 0.25)) if rng.random() < 0.5 else None
        low = grade(difficulty, 1.30, 0.95) + float(rng.uniform(0.0, 0.08))
        found += lamp(f"lamp_{i + 1}", float(x), float(rng.uniform(-0.35, 0.35)), radius, low, height)
    return found


def s_bend(difficulty: float, rng: np.random.Generator) -> Obstacles:
    """Two walls from opposite sides, 0.62 to 0.75 m apart, so that the way bends twice.

    Seen along the way, their ends leave 0.30 to 0.08 m between them.
    """
    side, apart = either_side(rng), float(rng.uniform(0.62, 0.75))
    short, shift = 0.5 * grade(difficulty, 0.30, 0.08), float(rng.uniform(-0.08, 0.08))
    length = float(rng.uniform(0.06, 0.15))
    first = 1.18 - 0.5 * apart
    return [
        wall("wall_1", first, length, side * (short + shift), side * HALF_WIDTH_M),
        wall("wall_2", first + apart, length, -side * (short - shift), -side * HALF_WIDTH_M),
    ]


def combination(difficulty: float, rng: np.random.Generator) -> Obstacles:
    """Two different kinds out of ground, side and overhead, one behind the other or one above the other."""
    medium = 0.15 + 0.5 * difficulty
    kinds: dict[str, tuple[Typical, ...]] = {
        "ground": (one_pipe, one_step),
        "side": (side_gap, table),
        "overhead": (beam_across, lamps),
    }
    found: Obstacles = []
    for kind in rng.permutation(list(kinds))[:2]:
        make = kinds[kind][int(rng.integers(len(kinds[kind])))]
        found += make(medium, rng)
    return found


def gauntlet(difficulty: float, rng: np.random.Generator) -> Obstacles:
    """One obstacle of every kind: on the ground, at the side and overhead."""
    easy = 0.1 + 0.4 * difficulty
    ground = (one_pipe, one_step)[int(rng.integers(2))](easy, rng)
    side = (side_gap, table, slalom)[int(rng.integers(3))](easy, rng)
    return ground + side + (beam_across, lamps)[int(rng.integers(2))](easy, rng)


TYPICAL: dict[str, Typical] = {
    "one_pipe": one_pipe,
    "two_pipes": two_pipes,
    "one_step": one_step,
    "two_steps": two_steps,
    "beam_across": beam_across,
    "side_gap": side_gap,
    "narrow_gap": narrow_gap,
    "slalom": slalom,
    "table": table,
    "lamps": lamps,
    "s_bend": s_bend,
    "combination": combination,
    "gauntlet": gauntlet,
}
LOADS_M = {"narrow_gap": (0.1, 0.1, 0.1)}
"""Half extents of the load with which a family is judged, where not the largest (20 cm each)."""
