"""Map of a scene as FAST-LIO would have saved it: a lidar that hangs upside down on a robot, walked through a hall.

The map's frame M is that of the lidar's IMU where the robot stood when mapping began, upright at the scene's start: it
is upside down, leans by 2.9°, and is drift-free. The scene stands in a hall that is larger by `HALL_M` all round, with
cupboards beside it, by which floor and ceiling can be told apart.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hotice import checks
from hotice.checks import Range
from hotice.deploy.frames import Pose, lidar_in_pelvis
from hotice.model.frames import quat_from_yaw, quat_to_mat, rotation_z
from hotice.model.scene import GOAL_HEIGHT_M, Scene

Array = NDArray[np.float64]
HALL_M, WALL_M = 4.0, 2.4
"""The hall's walls are so far beyond the scene's bounds, and so high where there is no ceiling."""
CUPBOARD_M = (0.8, 0.5, 1.2)
"""Size of each of the two cupboards, halfway between the scene and the hall's side walls."""
FIELD_RAD = (math.radians(-7.0), math.radians(52.0))
"""Elevation that a MID-360 sees, in its own frame: downwards for one that hangs upside down."""
NEAREST_M, FARTHEST_M = 0.3, 30.0
"""Nearer is the robot's own body, and dropped."""
HIT_M, STEPS = 1e-3, 200
CLEAR_M = 0.2
"""So far from obstacles does the lidar pass."""
FIELDS = ("x", "y", "z", "intensity", "normal_x", "normal_y", "normal_z", "curvature")


@dataclass(frozen=True, kw_only=True)
class LidarScan:
    """How a map is made. Raises `InvalidConfig`."""

    rays: int = 400_000
    """Rays of the whole walk; those that hit nothing leave no point."""
    noise_m: float = 0.008
    """Standard deviation of a point's place [m]."""
    ceiling_m: float | None = None
    """Height of the hall's ceiling [m]; none: the sky."""
    seed: int = 0
    """Of directions and noise."""

    def __post_init__(self) -> None:
        checks.whole("rays", self.rays, Range(least=1000, most=10_000_000))
        checks.number("noise_m", self.noise_m, Range(least=0, most=0.1, unit="m"))
        if self.ceiling_m is not None:
            checks.number("ceiling_m", self.ceiling_m, Range(least=1.6, most=20, unit="m"))
        checks.whole("seed", self.seed, checks.INT64)


def map_in_scene(scene: Scene) -> Pose:
    """X_WM of the map that `scan` makes; its IMU was above the scene's start, heading as the robot starts."""
    x, y, yaw = scene.start
    X_PL = lidar_in_pelvis(np.zeros(3))
    return Pose(quat_to_mat(quat_from_yaw(yaw)) @ X_PL.R, np.array([x, y, GOAL_HEIGHT_M + X_PL.p[2]]))


def scan(scene: Scene, config: LidarScan) -> Array:
    """Points (n, 3) of the map in M [m]."""
    rng = np.random.default_rng(config.seed)
    X_WM = map_in_scene(scene)
    places = _walk(scene, X_WM.p[2])
    around = _Around(scene, config.ceiling_m)
    which = rng.integers(len(places), size=config.rays)
    azimuth = rng.uniform(-math.pi, math.pi, config.rays)
    lowest, highest = map(math.sin, FIELD_RAD)
    up = rng.uniform(lowest, highest, config.rays)
    level = np.sqrt(1.0 - up**2)
    ahead_L = np.stack([level * np.cos(azimuth), level * np.sin(azimuth), up], axis=1)
    # the robot looks the other way on each second place, as who walks about does
    turns = np.array([X_WM.R, rotation_z(math.pi) @ X_WM.R])
    ahead_W = np.einsum("nij,nj->ni", turns[which % 2], ahead_L)
    hits = _hits(around, places[which], ahead_W)
    return X_WM.inverse.points(hits + rng.normal(0.0, config.noise_m, hits.shape))


def pcd_of(points: Array) -> bytes:
    """A PCD file of points (n, 3) with the fields, and in the encoding, of FAST-LIO's."""
    rows = np.zeros((len(points), len(FIELDS)), "<f4")
    rows[:, :3] = points
    count = len(FIELDS)
    header = (
        f"# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS {' '.join(FIELDS)}\n"
        f"SIZE {' '.join(['4'] * count)}\nTYPE {' '.join(['F'] * count)}\nCOUNT {' '.join(['1'] * count)}\n"
        f"WIDTH {len(points)}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {len(points)}\nDATA binary\n"
    )
    return header.encode() + rows.tobytes()


def _walk(scene: Scene, height_m: float) -> Array:
    """Places of the lidar (n, 3) [m]: from start to goal, and round the scene, where nothing is near."""
    low, high = (np.array(corner[:2]) for corner in scene.bounds_m)
    middle, half = 0.5 * (low + high), 0.5 * (high - low) + 0.25 * HALL_M
    angle = np.linspace(0.0, 2.0 * math.pi, 24, endpoint=False)
    round_it = middle + math.sqrt(2.0) * half * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    through = np.linspace(scene.start[:2], scene.goal, 24)
    places = np.column_stack([np.concatenate([round_it, through]), np.full(48, height_m)])
    return places[_Around(scene, None).distance(places) > CLEAR_M]


def _hits(around: _Around, eye: Array, ahead: Array) -> Array:
    """Where rays from `eye` (n, 3) along `ahead` (n, 3) first meet something, (m, 3); those that do not are left."""
    along, going, met = np.zeros(len(eye)), np.arange(len(eye)), []
    for _ in range(STEPS):
        free = around.distance(eye[going] + along[going, None] * ahead[going])
        met.append(going[(free < HIT_M) & (along[going] > NEAREST_M)])
        along[going] += np.maximum(free, 0.0)
        going = going[(free >= HIT_M) & (along[going] < FARTHEST_M)]
    hit = np.concatenate(met)
    return eye[hit] + along[hit, None] * ahead[hit]


class _Around:
    """The hall with the scene and its cupboards."""

    def __init__(self, scene: Scene, ceiling_m: float | None) -> None:
        self._scene, self._ceiling_m = scene, ceiling_m
        self._low, self._high = (np.array(corner[:2]) for corner in scene.bounds_m)
        middle, aside = 0.5 * (self._low + self._high), 0.5 * HALL_M
        self._half = 0.5 * np.array(CUPBOARD_M)
        self._cupboards = [
            np.array([middle[0], y, self._half[2]]) for y in (self._low[1] - aside, self._high[1] + aside)
        ]

    def distance(self, p: Array) -> Array:
        """Distance of points (n, 3) to the nearest thing [m]; a lower bound above walls under the sky."""
        parts = [self._scene.signed_distance(p), self._of_hall(p)]
        for centre in self._cupboards:
            beyond = np.abs(p - centre) - self._half
            outside = np.linalg.norm(np.maximum(beyond, 0.0), axis=1)
            parts.append(outside + np.minimum(beyond.max(axis=1), 0.0))
        return np.min(parts, axis=0)

    def _of_hall(self, p: Array) -> Array:
        aside = np.minimum(p[:, :2] - self._low, self._high - p[:, :2]).min(axis=1) + HALL_M
        if self._ceiling_m is not None:
            return np.minimum(np.minimum(aside, p[:, 2]), self._ceiling_m - p[:, 2])
        over = np.maximum(p[:, 2] - WALL_M, 0.0)
        beside = np.where(over > 0.0, np.hypot(np.maximum(aside, 0.0), over), aside)
        return np.minimum(beside, p[:, 2])
