"""Parametric scene families, each graded from easy to hard, for curricula (scene types of the paper, section V).

A family maps a difficulty in 0..1 and a place along the path to obstacles. Sizes that decide the difficulty are
functions of the difficulty alone; where things stand is drawn from a generator seeded with (seed, family, index).
Proportions fit a G1 (1.32 m tall, shoulders 0.45 m wide) with a box of up to 0.4 m ahead of it: obstacles keep clear
of both at start and goal. All numbers are ours.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable

import numpy as np

from hotice.errors import InvalidScene, UnknownName
from hotice.model.scene import Obstacle, Scene
from hotice.model.shapes import BoxShape, CylinderShape, Shape, SphereShape

MAX_COUNT = 10_000
NEAREST_M, FARTHEST_M = 0.60, 1.75
"""Along x, what is near the centre line stands ahead of a box held at the start and behind the robot at the goal."""
HALF_WIDTH_M, CEILING_M = 1.0, 1.6
ACROSS = (math.sqrt(0.5), math.sqrt(0.5), 0.0, 0.0)
"""Orientation wxyz that lays a cylinder along y."""

Obstacles = list[Obstacle]
Family = Callable[[float, float, np.random.Generator], Obstacles]


def family_scenes(name: str, count: int, seed: int = 0) -> list[Scene]:
    """`count` scenes named `<family>_<index>`, from easy to hard; `mixed` deals out all families in turn.

    Scene i depends on the family's name, i, `count` (which spaces the difficulty) and `seed` only.

    Raises:
        UnknownName: no such family.
        InvalidScene: `count` is not in 1..10,000 or `seed` is negative.
    """
    if name not in FAMILIES:
        raise UnknownName("scene family", name, FAMILIES)
    if not 1 <= count <= MAX_COUNT:
        raise InvalidScene(f"scene family {name!r}: count is {count!r}: 1 to {MAX_COUNT:,} are allowed")
    if seed < 0:
        raise InvalidScene(f"scene family {name!r}: seed is {seed!r}: a number of at least 0 is needed")
    if name != "mixed":
        return [_scene(name, i, float(t), seed) for i, t in enumerate(np.linspace(0.0, 1.0, count))]
    turn = [family for family in FAMILIES if family != "mixed"]
    parts = [family_scenes(f, len(range(k, count, len(turn))), seed) for k, f in enumerate(turn) if k < count]
    return [parts[i % len(turn)][i // len(turn)] for i in range(count)]


def family_from_text(text: str) -> list[Scene]:
    """Scenes of `NAME:COUNT` or `NAME:COUNT:SEED`. Raises as `family_scenes`, and `InvalidScene` for other text."""
    name, *numbers = text.split(":")
    if name not in FAMILIES:
        raise UnknownName("scene family", name, FAMILIES)
    if not 1 <= len(numbers) <= 2 or not all(n.isascii() and n.isdigit() and len(n) < 19 for n in numbers):
        raise InvalidScene(
            f"scene family {text!r}: NAME:COUNT or NAME:COUNT:SEED is needed, such as pipe:12 or pipe:12:3"
        )
    return family_scenes(name, *map(int, numbers))


def _scene(name: str, index: int, difficulty: float, seed: int) -> Scene:
    rng = np.random.default_rng([seed, zlib.crc32(name.encode()), index])
    title = f"{name}_{index:02d}"
    if name == "open":
        return _open(title, difficulty, rng)
    if name == "combo":
        first, second = (list(SINGLE)[i] for i in rng.choice(len(SINGLE), 2, replace=False))
        medium = 0.3 + 0.4 * difficulty
        obstacles = SINGLE[first](medium, 0.75, rng) + SINGLE[second](medium, 1.4, rng)
    elif name == "pillars":
        obstacles = _pillars(difficulty, rng)
    else:
        obstacles = SINGLE[name](difficulty, float(rng.uniform(0.8, 1.3)), rng)
    return Scene(title, obstacles=tuple(obstacles))


def _grade(difficulty: float, easy: float, hard: float) -> float:
    return easy + difficulty * (hard - easy)


def _side(rng: np.random.Generator) -> float:
    return float(rng.choice([-1.0, 1.0]))


def _within(x: float, half: float) -> float:
    """X moved so that x ± half keeps clear of what is held at the start and of the robot at the goal."""
    return min(max(x, NEAREST_M + half), FARTHEST_M - half)


def _obstacle(name: str, category: str, shape: Shape, *position: float, quat=(1.0, 0.0, 0.0, 0.0)) -> Obstacle:
    return Obstacle(name, category, shape, position, quat)  # type: ignore[arg-type]


def _open(name: str, difficulty: float, rng: np.random.Generator) -> Scene:
    """No obstacles; the goal 1 to 2.2 m away, within ± 35 degrees. Bounds widen where it needs them."""
    distance, bearing = _grade(difficulty, 1.0, 2.2), math.radians(rng.uniform(-35.0, 35.0))
    goal = (distance * math.cos(bearing), distance * math.sin(bearing))
    half_width = max(HALF_WIDTH_M, abs(goal[1]) + 0.5)
    return Scene(name, ((-0.5, -half_width, 0.0), (2.5, half_width, 1.5)), goal=goal)


def _pipe(difficulty: float, x: float, rng: np.random.Generator) -> Obstacles:
    """A pipe on the ground across the path, radius 1 to 5 cm."""
    radius = _grade(difficulty, 0.01, 0.05)
    x = _within(x + rng.uniform(-0.1, 0.1), 0.1)
    return [_obstacle("pipe", "ground", CylinderShape(radius, 2 * HALF_WIDTH_M), x, 0.0, radius, quat=ACROSS)]


def _step(difficulty: float, x: float, rng: np.random.Generator) -> Obstacles:
    """A bar on the ground across the path, 4 to 8 cm long, 1 to 10 cm high."""
    length, height = rng.uniform(0.04, 0.08), _grade(difficulty, 0.01, 0.10)
    x = _within(x + rng.uniform(-0.1, 0.1), 0.1)
    return [_obstacle("step", "ground", BoxShape((length, 2 * HALF_WIDTH_M, height)), x, 0.0, 0.5 * height)]


def _gap(difficulty: float, x: float, rng: np.random.Generator) -> Obstacles:
    """A doorway of two full-height boxes, 1.05 to 0.70 m wide, up to 15 cm off the centre line."""
    width, offset, length = _grade(difficulty, 1.05, 0.70), rng.uniform(-0.15, 0.15), rng.uniform(0.1, 0.4)
    x = _within(x, 0.5 * length)
    obstacles = []
    for name, side in (("left_wall", 1.0), ("right_wall", -1.0)):
        inner = side * offset + 0.5 * width  # distance from the centre line to this wall
        size = (length, HALF_WIDTH_M - inner, 1.5)
        obstacles.append(_obstacle(name, "side", BoxShape(size), x, side * 0.5 * (HALF_WIDTH_M + inner), 0.75))
    return obstacles


def _pillars(difficulty: float, rng: np.random.Generator) -> Obstacles:
    """Two or three pillars left and right in turn; the free width between neighbours is 0.75 to 0.65 m."""
    free, side = _grade(difficulty, 0.75, 0.65), _side(rng)
    number = int(rng.integers(2, 4))
    radius = float(rng.uniform(0.05, 0.12))
    spacing = {2: 0.58, 3: 0.46}[number]
    middle = 1.2 + rng.uniform(-0.03, 0.03)
    aside = 0.5 * math.sqrt((free + 2 * radius) ** 2 - spacing**2)
    obstacles = []
    for i in range(number):
        x, y = middle + (i - 0.5 * (number - 1)) * spacing, side * (-1) ** i * aside
        obstacles.append(_obstacle(f"pillar_{i + 1}", "side", CylinderShape(radius, 1.5), x, y, 0.75))
    return obstacles


def _table_edge(difficulty: float, x: float, rng: np.random.Generator) -> Obstacles:
    """A table from one side: top 70 to 95 cm high and 4 cm thick, its edge 0.45 to 0.20 m from the centre line."""
    edge, side = _grade(difficulty, 0.45, 0.20), _side(rng)
    length, height, thick = rng.uniform(0.4, 0.6), rng.uniform(0.70, 0.95), 0.04
    x, width, leg = _within(x, 0.5 * length), HALF_WIDTH_M - edge, 0.05
    top = BoxShape((length, width, thick))
    obstacles = [_obstacle("table_top", "side", top, x, side * (edge + 0.5 * width), height - 0.5 * thick)]
    for i, end in enumerate((-1.0, 1.0)):
        at = x + end * 0.5 * (length - leg), side * (HALF_WIDTH_M - 0.5 * leg)
        shape = BoxShape((leg, leg, height - thick))
        obstacles.append(_obstacle(f"table_leg_{i + 1}", "side", shape, *at, 0.5 * (height - thick)))
    return obstacles


def _beam(difficulty: float, x: float, rng: np.random.Generator) -> Obstacles:
    """A beam across at head height, 10 to 30 cm long, its underside 1.36 to 1.05 m high."""
    under, length = _grade(difficulty, 1.36, 1.05), rng.uniform(0.1, 0.3)
    height = CEILING_M - under
    shape = BoxShape((length, 2 * HALF_WIDTH_M, height))
    return [_obstacle("beam", "overhead", shape, _within(x, 0.5 * length), 0.0, under + 0.5 * height)]


def _hanging(difficulty: float, x: float, rng: np.random.Generator) -> Obstacles:
    """A lamp on a cord: ball or short cylinder, lower end 1.35 to 1.0 m high, up to 0.3 m off the centre line."""
    low, radius = _grade(difficulty, 1.35, 1.0), rng.uniform(0.10, 0.18)
    height = float(rng.choice([2 * radius, rng.uniform(0.12, 0.25)]))
    shape = SphereShape(radius) if height == 2 * radius else CylinderShape(radius, height)
    x, y = _within(x, radius), rng.uniform(-0.3, 0.3)
    obstacles = [_obstacle("lamp", "overhead", shape, x, y, low + 0.5 * height)]
    cord = CEILING_M - (low + height)
    if cord > 0.01:
        obstacles.append(_obstacle("cord", "overhead", CylinderShape(0.015, cord), x, y, CEILING_M - 0.5 * cord))
    return obstacles


SINGLE: dict[str, Family] = {
    "pipe": _pipe, "step": _step, "gap": _gap, "table_edge": _table_edge, "beam": _beam, "hanging": _hanging,
}  # fmt: skip
"""Families of one obstacle (or pair) at a given place along x; `combo` joins two of them."""
FAMILIES = ("open", "pipe", "step", "gap", "pillars", "table_edge", "beam", "hanging", "combo", "mixed")
