"""Footsteps along a way: alternating, evenly spaced where the floor is free, to both sides of what lies on it.

The stations of the steps minimise the squared deviation from the usual step length; stations where a sole would touch a
ground obstacle are left out. One dynamic programme over (station, foot) finds them.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from hotice.control.walk.config import WalkConfig
from hotice.control.walk.ground import Ground
from hotice.control.walk.path import WalkPath
from hotice.control.walk.swing import SwingShape
from hotice.errors import UnreachableGoal

Array = NDArray[np.float64]
GRID_M = 0.01
MAX_SLACK_M = 0.40
SLACK_MARGIN_M = 0.010
"""Distance of a sole to ground obstacles that step adjustment keeps."""
_RISE, _LEAVE, _ARRIVE, _FALL = (
    (0.45, 0.4, 0.35, 0.3),
    (0.0, 0.1, 0.15, 0.2, 0.25),
    (0.95, 0.85, 0.8, 0.75),
    (0.5, 0.6, 0.65, 0.7),
)
LEFT, RIGHT = 0, 1
SIDE = (1.0, -1.0)


@dataclass(frozen=True)
class Footstep:
    """Where and when a foot lands, and how it gets there.

    Attributes:
        foot: 0 left, 1 right. x, y: of the ankle [m]. yaw: [rad]. station: of the way [m].
        span_s: single support before the landing. time_s: of the landing since the start.
        swing: over what lies between. slack_m: how far back, ahead and away from the other foot the foothold may be
            moved.
    """

    foot: int
    x: float
    y: float
    yaw: float
    station: float
    span_s: float
    time_s: float
    swing: SwingShape
    slack_m: tuple[float, float, float]

    def hurry_s(self, config: WalkConfig) -> float:
        """By how much the landing may come earlier: hardly, where the foot has to pass over something [s]."""
        return config.hurry_s if self.swing.apex_m <= config.swing_height_m else 0.25 * config.hurry_s

    @property
    def xy(self) -> Array:
        """(2,) [m]."""
        return np.array([self.x, self.y])


def foot_place(path: WalkPath, station: Array | float, foot: int, half_width_m: float) -> tuple[Array, Array]:
    """Ankle position (..., 2) [m] and yaw (...) [rad] of a foot beside the way."""
    xy, yaw = path.at(station)
    return xy + SIDE[foot] * half_width_m * np.stack([-np.sin(yaw), np.cos(yaw)], axis=-1), yaw


def plan_footsteps(
    path: WalkPath, ground: Ground, config: WalkConfig, *, first_foot: int = LEFT, from_station: float = 0.0
) -> list[Footstep]:
    """Steps that bring both feet from `from_station` to the end of the way; the last two land side by side.

    Raises `UnreachableGoal` where ground obstacles leave no foothold within the longest step.
    """
    end = path.length_m
    count = max(2, int(np.ceil((end - from_station) / GRID_M)) + 1)
    stations = np.linspace(from_station, end, count)
    if end - from_station < 2 * GRID_M:
        return []
    spacing = stations[1] - stations[0]
    free: list[NDArray[np.bool_]] = []
    for foot in (LEFT, RIGHT):
        xy, yaw = foot_place(path, stations, foot, config.half_width_m)
        free.append(ground.sole_height(xy, yaw) <= 0.0)
    chain = _chain(free, spacing, config, first_foot)
    if chain is None:
        raise UnreachableGoal(
            f"no footholds within steps of {config.longest_step_m:g} m lead over the ground obstacles: "
            "raise longest_step_m or move the obstacles"
        )
    steps = []
    near = Ground(ground.scene, min(SLACK_MARGIN_M, ground.margin_m))
    place = {f: np.array(foot_place(path, from_station, f, config.half_width_m)[0]) for f in (LEFT, RIGHT)}
    time_s = config.shift_s
    for foot, k in [*chain, (1 - chain[-1][0], count - 1)]:
        xy, yaw = foot_place(path, stations[k], foot, config.half_width_m)
        swing, span = plan_swing(ground, place[foot], xy, float(yaw), config)
        slack = free_slack(near, xy, float(yaw), SIDE[foot])
        time_s += span
        steps.append(
            Footstep(foot, float(xy[0]), float(xy[1]), float(yaw), float(stations[k]), span, time_s, swing, slack)
        )
        time_s += config.double_support_s
        place[foot] = np.asarray(xy)
    return steps


def _chain(
    free: list[NDArray[np.bool_]], spacing: float, config: WalkConfig, first_foot: int
) -> list[tuple[int, int]] | None:
    """Cheapest alternating chain (foot, index) to the last station, without the closing step; None where there is none.

    best[foot, k, g]: of chains whose last step, of that foot, gained g stations and landed on station k. A step is
    priced by its gain and by what its foot travels, the gain of the step before included.
    """
    count, usual = len(free[LEFT]), config.step_length_m
    reach = min(int(np.floor(config.longest_step_m / spacing + 1e-9)), count - 1)
    gain = np.arange(reach + 1) * spacing
    price = ((gain - usual) / usual) ** 2 + 0.05 + 2.0 * np.maximum(gain / usual - 1.0, 0.0) ** 2
    price[gain < 0.5 * usual] += 0.3  # a shuffle costs time
    travel = gain[:, None] + gain  # of a foot, by its own gain and the gain before
    far = 8.0 * (np.maximum(travel - 2.0 * usual, 0.0) / usual) ** 2
    best = np.full((2, count, reach + 1), np.inf)
    before = np.full((2, count, reach + 1), -1)
    best[1 - first_foot, 0, 0] = 0.0  # the feet stand side by side
    for k in range(count):
        for g in range(min(reach, k) + 1):
            for foot in (LEFT, RIGHT):
                if not free[foot][k] or (g == 0 and k != count - 1):
                    continue
                options = best[1 - foot, k - g] + far[g]
                i = int(np.argmin(options))
                cost = options[i] + price[g]
                if cost < best[foot, k, g]:
                    best[foot, k, g], before[foot, k, g] = cost, i
    ends = [(best[f, -1].min() if free[1 - f][-1] else np.inf) for f in (LEFT, RIGHT)]
    foot = int(np.argmin(ends))
    if not np.isfinite(ends[foot]):
        return None
    k, g = count - 1, int(np.argmin(best[foot, -1]))
    chain = []
    while before[foot, k, g] >= 0:
        chain.append((foot, k))
        foot, k, g = 1 - foot, k - g, int(before[foot, k, g])
    return chain[::-1]


def plan_swing(ground: Ground, start: Array, end: Array, yaw: float, config: WalkConfig) -> tuple[SwingShape, float]:
    """The quickest swing whose sole passes over everything between two footholds, and its time [s].

    What is below the sole is compared along the whole swing; where no shape of the table passes, the most cautious is
    taken.
    """
    distance = float(np.linalg.norm(end - start))
    share = np.linspace(0.0, 1.0, 41)
    needed = ground.sole_height(start + share[:, None] * (end - start), yaw)
    needed = np.where(needed > 0.0, needed + config.swing_clearance_m, 0.0)
    needed[[0, -1]] = 0.0
    apex = max(config.swing_height_m, float(needed.max()))
    usual = SwingShape(apex_m=apex)
    if not needed.any():
        return usual, config.swing_time(distance, usual)
    heights, travels = _swing_table()
    below = np.interp(travels, share, needed)
    passes = np.all(apex * heights >= below - 1e-9, axis=1).tolist()
    shapes = [replace(shape, apex_m=apex) for shape, good in zip(_shapes(), passes, strict=True) if good]
    shapes = shapes or [SwingShape(apex_m=apex, rise=0.3, leave=0.3, arrive=0.7, fall=0.7)]
    spans = [config.swing_time(distance, shape) for shape in shapes]
    k = int(np.argmin(spans))
    return shapes[k], spans[k]


def _shapes() -> list[SwingShape]:
    return [
        SwingShape(apex_m=1.0, rise=rise, leave=leave, arrive=arrive, fall=fall)
        for rise, leave, arrive, fall in itertools.product(_RISE, _LEAVE, _ARRIVE, _FALL)
    ]


@lru_cache(maxsize=1)
def _swing_table() -> tuple[Array, Array]:
    """Height over the apex, and share of the way, of every shape at 81 instants, (shapes, 81) each."""
    u = np.linspace(0.0, 1.0, 81)
    heights = np.array([[shape.height(v)[0] for v in u] for shape in _shapes()])
    return heights, np.array([[shape.travel(v) for v in u] for shape in _shapes()])


def free_slack(ground: Ground, xy: Array, yaw: float, side: float) -> tuple[float, float, float]:
    """Distance that a foothold may move before its sole touches something, at most `MAX_SLACK_M` [m].

    Back, ahead, and away from the other foot: to the left where `side` is +1, else to the right.
    """
    c, s = np.cos(yaw), np.sin(yaw)
    offsets = np.arange(GRID_M, MAX_SLACK_M + 1e-9, GRID_M)
    ways = []
    for direction in ((-c, -s), (c, s), (-side * s, side * c)):
        blocked = np.asarray(ground.sole_height(xy + offsets[:, None] * np.array(direction), yaw) > 0.0)
        ways.append(float(offsets[blocked.argmax()] - GRID_M) if blocked.any() else MAX_SLACK_M)
    return ways[0], ways[1], ways[2]
