"""Ways through a furnished place, and the scene that is cut out round one of them.

The place lies in a frame H (floor at z = 0); the scene's frame W has its origin below the start and its x axis towards
the goal, so that start is (0, 0, 0) and goal (d, 0).
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import map_coordinates

from hotice.errors import InvalidScene
from hotice.model.frames import quat_from_yaw, quat_mul, quat_rotate
from hotice.model.generate.traversable import check_traversable
from hotice.model.geometry.extents import extent
from hotice.model.geometry.lengths import SMALL_M
from hotice.model.scene import Obstacle, Scene
from hotice.model.source import MapSource

Array = NDArray[np.float64]
SPACING_M = 0.1
OFF_LIMITS_M = -1.0
"""Clearance where no way may lead, such as behind a wall; what is interpolated half-way to it counts as well."""

BODY_M, LOAD_M, LOAD_AHEAD_M = 0.34, 0.26, 0.45
"""Room that the body needs at start and goal, and the load ahead of it."""
CORRIDOR_M, RUN_M = 2.0, 1.0
"""A way through is looked for in a strip this wide, longer than the way by `RUN_M`: larger detours take too long."""
NEAR_M = 0.6
"""Things nearer to the straight way than this crowd it."""


@dataclass(frozen=True, eq=False, kw_only=True)
class ClearanceMap:
    """Distance from the floor of H to the nearest thing a robot would touch, or `OFF_LIMITS_M`.

    `nearest` (nx, ny) [m] at the nodes `origin` (2,) + index * `SPACING_M`, `things` the distance without walls; linear
    between the nodes, off limits outside.
    """

    origin: Array
    nearest: Array
    things: Array

    def __call__(self, p_H: Array) -> Array:
        """Clearance at (..., 2) -> (...) [m]."""
        return self._at(self.nearest, p_H)

    def to_things(self, p_H: Array) -> Array:
        """Distance to the nearest thing that is no wall, (..., 2) -> (...) [m]."""
        return self._at(self.things, p_H)

    def _at(self, values: Array, p_H: Array) -> Array:
        index = np.moveaxis((p_H - self.origin) / SPACING_M, -1, 0)
        flat = map_coordinates(values, index.reshape(2, -1), order=1, mode="constant", cval=OFF_LIMITS_M)
        return flat.reshape(np.shape(p_H)[:-1])

    def nodes(self, least_m: float) -> Array:
        """Nodes with a clearance above `least_m`, (n, 2) in H [m]."""
        return self.origin + SPACING_M * np.argwhere(self.nearest > least_m)


@dataclass(frozen=True, kw_only=True)
class Way:
    """Start and goal on the floor of H [m]; `crowding`: mean of how far things (not walls) reach into `NEAR_M`."""

    start: tuple[float, float]
    goal: tuple[float, float]
    crowding: float

    @property
    def length_m(self) -> float:
        """Straight distance."""
        return math.dist(self.start, self.goal)


def propose_ways(clearance: ClearanceMap, rng: np.random.Generator, count: int = 4000) -> list[Way]:
    """Ways 2 m (every other) or 2 to 3 m long that pass clutter, the least crowded first.

    Args:
        clearance: of the place; start and goal, with a load ahead, keep `BODY_M` and `LOAD_M`.
        rng: draws `count` candidates, of which the fitting ones come back.
    """
    floor = clearance.nodes(BODY_M)
    if not len(floor):
        return []
    start = floor[rng.integers(len(floor), size=count)] + rng.uniform(-0.05, 0.05, (count, 2))
    angle = rng.uniform(-math.pi, math.pi, count)
    ahead = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    length = np.where(rng.random(count) < 0.5, 2.0, rng.uniform(2.0, 3.0, count))
    goal = start + length[:, None] * ahead
    fits = np.ones(count, bool)
    for place in (start, goal):
        fits &= (clearance(place) > BODY_M) & (clearance(place + LOAD_AHEAD_M * ahead) > LOAD_M)
    start, goal = start[fits], goal[fits]
    line = start[:, None] + np.linspace(0.0, 1.0, 32)[:, None] * (goal - start)[:, None]
    crowding = np.maximum(NEAR_M - clearance.to_things(line), 0.0).mean(axis=1)
    passing = (crowding > 0.0) & (clearance(line).min(axis=1) > 0.5 * OFF_LIMITS_M)
    order = [i for i in np.argsort(crowding, kind="stable") if passing[i]]
    return [Way(start=tuple(start[i]), goal=tuple(goal[i]), crowding=float(crowding[i])) for i in order]


def crop(
    name: str,
    obstacles: Iterable[Obstacle],
    start: ArrayLike,
    goal: ArrayLike,
    size_m: tuple[float, float, float],
    source: MapSource | None = None,
) -> Scene:
    """The scene of `size_m` (along the way, across, up) [m], centred on the way; obstacles that reach into it are kept.

    Args:
        name: of the scene. obstacles: in H. size_m: full extent of the bounds.
        start: x, y in H [m]. goal: x, y in H [m]. source: the map that H was made of, if any; the crop keeps it.

    Raises:
        InvalidScene: start and goal coincide or do not lie inside the size, or an obstacle stands on one of them.
    """
    p_HS, p_HG = np.array(start, dtype=float), np.array(goal, dtype=float)
    ahead = p_HG - p_HS
    length = round(float(np.linalg.norm(ahead)), 6)
    if not 0.1 < length < size_m[0]:
        raise InvalidScene(f"goal is {length:.3g} m from start: 0.1 m to {size_m[0]:g} m fit a crop of {size_m} m")
    low = np.array([0.5 * (length - size_m[0]), -0.5 * size_m[1], 0.0]).round(4)
    high = (low + size_m).round(4)
    p_HW, quat_WH = np.array([*p_HS, 0.0]), quat_from_yaw(-math.atan2(ahead[1], ahead[0]))
    kept = []
    for obstacle in obstacles:
        moved = replace(
            obstacle,
            position_m=tuple(quat_rotate(quat_WH, np.array(obstacle.position_m) - p_HW).round(6).tolist()),
            quaternion_wxyz=tuple(quat_mul(quat_WH, obstacle.quaternion_wxyz).tolist()),
        )
        bottom, top = extent(moved)
        if (bottom < high).all() and (top > low).all():
            kept.append(moved)
    moved_source = source and source.moved(quat_rotate(quat_WH, -p_HW), quat_WH)
    bounds = (tuple(low.tolist()), tuple(high.tolist()))
    return Scene(name, bounds, (0.0, 0.0, 0.0), (length, 0.0), tuple(kept), moved_source)


def why_blocked(obstacles: Iterable[Obstacle], way: Way) -> str:
    """Why a load cannot be carried along the way within `CORRIDOR_M`; empty when it can, also in every larger crop."""
    size_m = (way.length_m + RUN_M, CORRIDOR_M, SMALL_M[2])
    try:
        return check_traversable(crop("way", obstacles, way.start, way.goal, size_m)).reason
    except InvalidScene as error:
        return str(error)
