"""The floor of a measured map: a plane by random sampling, refined by least squares.

Map frame M: as the file has it, its z axis roughly up. The fit turns M by the smallest rotation that makes the floor
level and lifts it to z = 0: p_W = R_WM (p_M - origin_M) - height e_z. So x and y of W are those of the map up to the
tilt; the origin is that of the map, but where the map lies far from it (survey coordinates, altitude above the sea).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from hotice.compiled import compiled
from hotice.errors import InvalidMap
from hotice.model.frames import quat_from_axis_angle, quat_to_mat

Points = NDArray[np.float64]
MAX_TILT_RAD = math.radians(20.0)
BAND_M, MIN_BAND_M = 0.03, 0.002
CELL_M = 0.08
"""Points are thinned to one per cell of this size, so that area counts and not nearness to the sensor."""
LEVEL_SHARE, CONTRAST, MIN_AREA_M2 = 0.3, 3.0, 0.5
"""The floor is the lowest level of at least this share of the largest one, stands out from what is near above and below
by this factor, and has at least this area."""
LEANING_AREA_M2 = 2.0
_TRIALS, _SAMPLE = 2000, 20_000


@dataclass(frozen=True, kw_only=True)
class Floor:
    """`R_WM` (3, 3); `height_m` of the floor along W's z before it is lifted; `noise_m` standard deviation about it.

    `origin_M` (3,) [m]: the place that M is turned about, and below which W has its origin.
    """

    R_WM: NDArray[np.float64]
    height_m: float
    noise_m: float
    origin_M: NDArray[np.float64] = field(default_factory=lambda: np.zeros(3))

    @classmethod
    def given(cls) -> Floor:
        """The floor is z = 0 of the map."""
        return cls(R_WM=np.eye(3), height_m=0.0, noise_m=0.0)

    def about(self, origin_M: NDArray[np.float64]) -> Floor:
        """The floor of a map of which `origin_M` (3,) was subtracted before this one was fitted."""
        return replace(self, origin_M=self.origin_M + origin_M)

    def among_cells(self, p_M: Points, cell_m: float) -> Floor:
        """The floor in the middle of all layers of cells that it fills, two where it lies between them.

        p_M: points (n, 3) that fill the cells evenly. cell_m: edge of a cell; 0: points as measured, nothing changes.
        """
        floor = self
        for _ in range(2 if cell_m else 0):
            z = floor.to_world(p_M)[:, 2]
            near = z[np.abs(z) < 1.5 * cell_m]
            if not len(near):
                # it lies between layers that are several cells apart
                break
            floor = replace(floor, height_m=floor.height_m + float(near.mean()))
        return floor

    @property
    def position_m(self) -> NDArray[np.float64]:
        """M's origin in W, (3,): p_W = R_WM p_M + position."""
        return self.to_world(np.zeros(3))

    @property
    def tilt_rad(self) -> float:
        """Angle between the map's z axis and the floor's normal."""
        return math.acos(min(1.0, float(self.R_WM[2, 2])))

    def to_world(self, p_M: Points) -> Points:
        """(..., 3) in M -> (..., 3) in W [m]."""
        return (p_M - self.origin_M) @ self.R_WM.T - [0.0, 0.0, self.height_m]

    def place_to_world(self, xy_M: tuple[float, float], yaw_rad: float = 0.0) -> tuple[float, float, float]:
        """A place on the floor and a heading given in the map's x, y -> x, y [m], yaw [rad] in W."""
        normal = self.R_WM[2]
        xy = np.array(xy_M) - self.origin_M[:2]
        on_floor = self.origin_M + [*xy, (self.height_m - normal[:2] @ xy) / normal[2]]
        ahead = np.array([math.cos(yaw_rad), math.sin(yaw_rad), 0.0])
        ahead[2] = -normal[:2] @ ahead[:2] / normal[2]
        x, y, _ = self.to_world(on_floor)
        dx, dy, _ = self.R_WM @ ahead
        return float(x), float(y), math.atan2(dy, dx)


def fit_floor(p_M: Points, seed: int = 0, thin: Points | None = None) -> Floor:
    """The floor under a map's points (n, 3) [m].

    The largest plane that is level within 20 degrees gives the direction; of all levels along it the floor is the
    lowest large one (not the ceiling, not a table). Exact for points without noise. Raises `InvalidMap` where no level
    stands out.

    Args:
        p_M: the points. seed: of the sampling. thin: the points thinned by `CELL_M`, where that is done already.
    """
    thin = _sample(thinned(p_M, CELL_M) if thin is None else thin, seed)
    triples = np.random.default_rng(seed).integers(0, len(thin), (_TRIALS, 3))
    counts, normals = _try_planes(thin, triples, BAND_M, math.cos(MAX_TILT_RAD))
    best = int(np.argmax(counts))
    if counts[best] == 0:
        raise _no_floor(f"no three points lie level within 20 degrees{_leaning(thin, triples)}")
    try:
        normal, height = _lowest_level(thin, normals[best])
    except InvalidMap as error:
        raise InvalidMap(f"{error}{_leaning(thin, triples)}") from None
    band = 2 * BAND_M
    for _ in range(4):
        near = thin[np.abs(thin @ normal - height) < band]
        if len(near) * CELL_M**2 < MIN_AREA_M2:
            raise _no_floor(f"the lowest level plane covers only {len(near) * CELL_M**2:.2f} m2")
        centre = near.mean(axis=0)
        _, axes = np.linalg.eigh(np.cov((near - centre).T))
        normal = axes[:, 0] * np.sign(axes[2, 0])
        height = float(normal @ centre)
        band = min(BAND_M, max(3.0 * _spread(near @ normal - height), MIN_BAND_M))
    residual = p_M @ normal - height
    residual = residual[np.abs(residual) < BAND_M]
    return Floor(R_WM=_level(normal), height_m=height, noise_m=_spread(residual))


def _sample(thin: Points, seed: int) -> Points:
    """At most `_SAMPLE` of the points. Raises `InvalidMap` for too few."""
    if len(thin) > _SAMPLE:
        thin = thin[np.random.default_rng(seed).choice(len(thin), _SAMPLE, replace=False)]
    if len(thin) < 50:
        raise _no_floor(f"the points fill only {len(thin)} cells of {100 * CELL_M:g} cm")
    return thin


def _leaning(thin: Points, triples: NDArray[np.int64]) -> str:
    """Advice on the largest plane that leans by 20 to 65 degrees, where it is large enough for a floor."""
    counts, normals = _try_planes(thin, triples, BAND_M, math.cos(math.radians(65.0)))
    best = int(np.argmax(counts))
    if counts[best] * CELL_M**2 < LEANING_AREA_M2:
        return ""
    x, y, z = normals[best]
    roll, pitch = math.degrees(math.atan2(y, z)), math.degrees(math.atan2(-x, math.hypot(y, z)))
    return (
        f". The largest plane ({counts[best] * CELL_M**2:.1f} m2) leans by {math.degrees(math.acos(z)):.0f} degrees: "
        f"if it is the floor, add --turn-deg {roll:.1f} {pitch:.1f}"
    )


def _spread(residual: NDArray[np.float64]) -> float:
    """Standard deviation of the middle half, as of a normal distribution: strangers do not count."""
    return 1.4826 * float(np.median(np.abs(residual)))


def thinned(p: Points, cell_m: float) -> Points:
    """One of the points in each cell that holds any, (n, 3) -> (m, 3)."""
    cell = np.floor((p - p.min(axis=0)) / cell_m).astype(np.int64)
    extent = cell.max(axis=0) + 1
    key = (cell[:, 0] * extent[1] + cell[:, 1]) * extent[2] + cell[:, 2]
    return p[np.unique(key, return_index=True)[1]]


def _lowest_level(thin: Points, normal: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
    level = thin @ normal
    bins = np.arange(level.min() - 1.0, level.max() + 1.0, 0.02)
    counts = np.convolve(np.histogram(level, bins)[0], np.ones(3), "same")
    k = int(np.argmax(counts >= LEVEL_SHARE * counts.max()))
    k += int(np.argmax(counts[k : k + 4]))
    around = np.r_[counts[k - 25 : k - 4], counts[k + 5 : k + 26]]
    if counts[k] < CONTRAST * max(float(around.mean()), 1.0):
        raise _no_floor("no level holds clearly more points than those above and below it")
    return normal, float(bins[k]) + 0.01


def _level(normal: NDArray[np.float64]) -> NDArray[np.float64]:
    """The smallest rotation that takes `normal` to z."""
    axis = np.array([normal[1], -normal[0], 0.0])
    sine = float(np.linalg.norm(axis))
    if sine < 1e-12:
        return np.eye(3)
    return quat_to_mat(quat_from_axis_angle(axis / sine, math.atan2(sine, normal[2]))).astype(np.float64)


def _no_floor(reason: str) -> InvalidMap:
    return InvalidMap(
        f"no floor found: {reason}; set the up axis, or say that the floor is z = 0 already (--floor given)"
    )


@compiled
def _try_planes(p, triples, band, cos_max_tilt):
    """For planes through triples of points: how many points lie within `band` (0 for steep planes), and the normals."""
    counts = np.zeros(len(triples), dtype=np.int64)
    normals = np.zeros((len(triples), 3))
    for t in range(len(triples)):
        a, b, c = p[triples[t, 0]], p[triples[t, 1]], p[triples[t, 2]]
        normal = np.cross(b - a, c - a)
        length = np.sqrt((normal**2).sum())
        if length < 1e-9 or abs(normal[2]) < cos_max_tilt * length:
            continue
        normal *= np.sign(normal[2]) / length
        offset = normal @ a
        for i in range(len(p)):
            distance = normal[0] * p[i, 0] + normal[1] * p[i, 1] + normal[2] * p[i, 2] - offset
            counts[t] += abs(distance) < band
        normals[t] = normal
    return counts, normals
