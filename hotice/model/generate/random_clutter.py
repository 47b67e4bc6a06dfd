"""Random clutter along a corridor: blocks on the ground, at the sides and overhead, round a lane that stays free.

The lane's centre line is a smooth random curve from start to goal, its half width and headroom smooth random functions
of x. Blocks are drawn all over the scene and kept where they leave the lane free, so that a way through is likely by
construction; `families` then checks it. Difficulty sets how crooked, narrow and low the lane is and how many blocks
press on it. All numbers are ours.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from hotice.model.frames import quat_from_yaw
from hotice.model.generate.pieces import FARTHEST_M, NEAREST_M, Obstacles, grade, ground_bar, lamp, obstacle
from hotice.model.geometry.shapes import BoxShape, CylinderShape

LENGTH_M = 2.0
FOOTING_M = 0.55
"""Distance between the middles of bars on the ground, which leaves a foothold."""


@dataclass(frozen=True, kw_only=True)
class Lane:
    """The free corridor: centre line, half width and headroom at x, by a few sine waves each."""

    waves: np.ndarray
    bend_m: float
    half_width_m: float
    headroom_m: float

    @classmethod
    def draw(cls, difficulty: float, rng: np.random.Generator) -> Lane:
        """A lane of a difficulty in 0..1."""
        return cls(
            waves=rng.uniform(-1.0, 1.0, (3, 3)),
            bend_m=grade(difficulty, 0.05, 0.22),
            half_width_m=grade(difficulty, 0.50, 0.32),
            headroom_m=grade(difficulty, 1.36, 1.16),
        )

    def _noise(self, row: int, x: float) -> float:
        """Smooth, in about -1..1, zero at start and goal."""
        phase = math.pi * x / LENGTH_M
        return sum(float(a) * math.sin((n + 1) * phase) / (n + 1) for n, a in enumerate(self.waves[row]))

    def centre(self, x: float) -> float:
        """Y of the centre line [m]."""
        return self.bend_m * self._noise(0, x)

    def half_width(self, x: float) -> float:
        """Free on both sides of the centre line [m]."""
        return self.half_width_m * (1.0 + 0.2 * abs(self._noise(1, x)))

    def headroom(self, x: float) -> float:
        """Free above the floor [m]."""
        return self.headroom_m + 0.1 * abs(self._noise(2, x))

    def room(self, x: float, y: float) -> float:
        """Distance from (x, y) to the lane's edge, negative inside [m]."""
        along = np.linspace(0.0, LENGTH_M, 41)
        return min(math.hypot(x - a, y - self.centre(a)) - self.half_width(a) for a in along.tolist())


def random_clutter(difficulty: float, rng: np.random.Generator) -> Obstacles:
    """Blocks of all categories along a lane."""
    lane = Lane.draw(difficulty, rng)
    return _sides(lane, difficulty, rng) + _overhead(lane, difficulty, rng) + _ground(difficulty, rng)


def _sides(lane: Lane, difficulty: float, rng: np.random.Generator) -> Obstacles:
    """Boxes and cylinders of any height, as near to the lane as their size allows."""
    found: Obstacles = []
    for i in range(round(grade(difficulty, 3, 9))):
        x, side, height = float(rng.uniform(0.2, 1.9)), float(rng.choice([-1.0, 1.0])), float(rng.uniform(0.5, 1.5))
        length, width = rng.uniform(0.08, 0.4, 2).tolist()
        reach = 0.5 * math.hypot(length, width)
        y = lane.centre(x) + side * (lane.half_width(x) + reach)
        while lane.room(x, y) < reach:
            y += 0.02 * side
        if rng.random() < 0.6:
            quat = tuple(quat_from_yaw(float(rng.uniform(0, math.pi))).tolist())
            shape = BoxShape((length, width, height))
        else:
            quat, shape = (1.0, 0.0, 0.0, 0.0), CylinderShape(reach, height)
        found.append(obstacle(f"block_{i + 1}", "side", shape, x, y, 0.5 * height, quat=quat))
    return found


def _overhead(lane: Lane, difficulty: float, rng: np.random.Generator) -> Obstacles:
    """Hanging boxes and lamps, anywhere above the headroom."""
    found: Obstacles = []
    for i in range(round(grade(difficulty, 0, 4))):
        x, y = float(rng.uniform(0.4, 1.8)), float(rng.uniform(-0.6, 0.6))
        low = lane.headroom(x) + float(rng.uniform(0.0, 0.08))
        if rng.random() < 0.5:
            found += lamp(f"lamp_{i + 1}", x, y, float(rng.uniform(0.06, 0.14)), low)
        else:
            length, width = float(rng.uniform(0.1, 0.4)), float(rng.uniform(0.3, 1.2))
            shape = BoxShape((length, width, 0.2))
            found.append(obstacle(f"hanging_{i + 1}", "overhead", shape, x, y, low + 0.1))
    return found


def _ground(difficulty: float, rng: np.random.Generator) -> Obstacles:
    """None to two bars across, 2 to 10 cm high."""
    number = int(rng.binomial(2, grade(difficulty, 0.1, 0.6)))
    first = float(rng.uniform(NEAREST_M + 0.15, FARTHEST_M - 0.15 - FOOTING_M * (number - 1))) if number else 0.0
    return [
        ground_bar(
            f"bar_{i + 1}",
            first + i * FOOTING_M,
            float(rng.uniform(0.04, 0.12)),
            grade(difficulty, 0.02, 0.10) * float(rng.uniform(0.7, 1.0)),
            float(rng.uniform(-0.1, 0.1)),
        )
        for i in range(number)
    ]
