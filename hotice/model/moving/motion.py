"""Motions of obstacles: way points with times, once or again and again, straight or smooth between them.

A motion is that of a frame M that goes through the way points, upright and turned by their yaw. An obstacle that has it
is fixed to M, and the pose that a scene file gives the obstacle is the one at the first way point. So the parts of a
person share a motion, and a door turns about a hinge at which M stays.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hotice import checks
from hotice.checks import Range, shown
from hotice.errors import InvalidScene
from hotice.model.geometry.lengths import COORDINATE

Array = NDArray[np.float64]
REPEATS = ("once", "loop")
COURSES = ("linear", "smooth")
TIME = Range(least=0, most=3600, unit="s")
ANGLE = Range(least=-1000, most=1000, unit="rad")
SHORTEST_S = 0.001
"""Least time between two way points."""
FASTEST_M_S, FASTEST_RAD_S = 5.0, 2.0 * math.pi
"""Highest speeds of M between way points: a sprint, and a full turn in a second."""
MOST_POINTS = 1000
_CLOSED = 1e-6


@dataclass(frozen=True, kw_only=True)
class WayPoint:
    """Place of M at a time: origin in W [m] and yaw [rad], by which M is turned to the left about z.

    Yaw is not taken modulo a full turn: 0 after 2π is a turn back. Raises `InvalidScene`.
    """

    time_s: float
    position_m: tuple[float, float, float]
    yaw_rad: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "time_s", checks.number("time_s", self.time_s, TIME, InvalidScene))
        position = checks.vector("position_m", self.position_m, 3, COORDINATE, InvalidScene)
        object.__setattr__(self, "position_m", position)
        object.__setattr__(self, "yaw_rad", checks.number("yaw_rad", self.yaw_rad, ANGLE, InvalidScene))


@dataclass(frozen=True, kw_only=True)
class Motion:
    """Course of M in time. Before the first way point M stays there; times count from the start of an episode.

    way_points: 2 to 1,000, their times growing. repeat: `once`, then M stays at the last one, or `loop`, then it goes
    on from the first, which must be where the last is. between: `linear`, at constant speed from each to the next, or
    `smooth`, without jumps of the velocity (cubic and monotone in each coordinate, Fritsch and Carlson 1980; at rest at
    both ends of what happens once). Raises `InvalidScene`, also for M faster than `FASTEST_M_S` or `FASTEST_RAD_S`.
    """

    way_points: tuple[WayPoint, ...]
    repeat: str = "once"
    between: str = "linear"

    def __post_init__(self) -> None:
        if not isinstance(self.way_points, list | tuple) or not all(isinstance(w, WayPoint) for w in self.way_points):
            raise InvalidScene(f"way_points is {shown(self.way_points)}: a list of way points is needed")
        object.__setattr__(self, "way_points", tuple(self.way_points))
        if not 2 <= len(self.way_points) <= MOST_POINTS:
            raise InvalidScene(f"{len(self.way_points):,} way_points: 2 to {MOST_POINTS:,} are needed")
        checks.one_of("repeat", self.repeat, REPEATS, InvalidScene)
        checks.one_of("between", self.between, COURSES, InvalidScene)
        for i, (a, b) in enumerate(zip(self.way_points, self.way_points[1:], strict=False)):
            if b.time_s - a.time_s < SHORTEST_S:
                raise InvalidScene(
                    f"way_points[{i + 1}] time_s is {b.time_s:g} after {a.time_s:g}: times must grow by at least "
                    f"{SHORTEST_S:g} s"
                )
        self._check_closed()
        self._check_speeds()

    def _check_closed(self) -> None:
        first, last = self.way_points[0], self.way_points[-1]
        if self.repeat != "loop":
            return
        if math.dist(first.position_m, last.position_m) > _CLOSED:
            raise InvalidScene(
                f"the last way point is at {last.position_m}, the first at {first.position_m}: a loop must end where "
                "it begins; add a way point there, or let repeat be 'once'"
            )
        if abs(math.remainder(last.yaw_rad - first.yaw_rad, 2.0 * math.pi)) > _CLOSED:
            raise InvalidScene(
                f"yaw_rad is {last.yaw_rad:g} at the last way point and {first.yaw_rad:g} at the first: a loop must "
                "end as it begins, or whole turns of 2 pi away from it"
            )

    def _check_speeds(self) -> None:
        for speed, fastest, what in (
            (self.top_speed_m_s, FASTEST_M_S, "m/s"),
            (self.top_rate_rad_s, FASTEST_RAD_S, "rad/s"),
        ):
            if not speed <= fastest * (1.0 + 1e-9):
                raise InvalidScene(
                    f"way_points are passed at up to {speed:.3g} {what}: at most {fastest:.3g} {what} is allowed; move "
                    "their times apart"
                )

    @cached_property
    def knots_s(self) -> Array:
        """Times of the way points, (K + 1,) [s]."""
        return np.array([w.time_s for w in self.way_points])

    @cached_property
    def cubics(self) -> Array:
        """Coefficients (K, 4, 4) of x, y, z [m] and yaw [rad] in powers 0 to 3 of the time since a way point [s]."""
        values, h = np.array([[*w.position_m, w.yaw_rad] for w in self.way_points]), np.diff(self.knots_s)[:, None]
        secant = np.diff(values, axis=0) / h
        if self.between == "linear":
            return np.stack([values[:-1], secant, np.zeros_like(secant), np.zeros_like(secant)], axis=-1)
        slope = self._slopes(secant, h)
        low, high = slope[:-1], slope[1:]
        return np.stack(
            [values[:-1], low, (3.0 * secant - 2.0 * low - high) / h, (low + high - 2.0 * secant) / h**2], axis=-1
        )

    def _slopes(self, secant: Array, h: Array) -> Array:
        """Velocities at the way points, (K + 1, 4): a weighted harmonic mean of both sides', 0 where they disagree."""
        if self.repeat == "loop":
            secant, h = np.concatenate([secant[-1:], secant, secant[:1]]), np.concatenate([h[-1:], h, h[:1]])
        before, after, a, b = secant[:-1], secant[1:], h[:-1], h[1:]
        agree = (before * after) > 0.0
        with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
            mean = 3.0 * (a + b) / ((2.0 * b + a) / before + (b + 2.0 * a) / after)
        inner = np.where(agree, np.nan_to_num(mean), 0.0)
        rest = np.zeros((1, 4))
        return inner if self.repeat == "loop" else np.concatenate([rest, inner, rest])

    @property
    def period_s(self) -> float:
        """Time after which a loop repeats itself; infinite for what happens once [s]."""
        return float(self.knots_s[-1] - self.knots_s[0]) if self.repeat == "loop" else math.inf

    @cached_property
    def top_speed_m_s(self) -> float:
        """Highest speed of M's origin."""
        return self._fastest(slice(0, 3))

    @cached_property
    def top_rate_rad_s(self) -> float:
        """Highest turning rate of M."""
        return self._fastest(slice(3, 4))

    def _fastest(self, axes: slice) -> float:
        """Highest rate at 64 moments of each part: of a parabola within a thousandth."""
        u = np.linspace(0.0, 1.0, 65)[:, None, None] * np.diff(self.knots_s)[:, None]
        c = self.cubics[:, axes]
        rate = c[..., 1] + u * (2.0 * c[..., 2] + u * 3.0 * c[..., 3])
        return float(np.linalg.norm(rate, axis=-1).max())

    def at(self, time_s: ArrayLike) -> tuple[Array, Array]:
        """Origin (..., 3) in W [m] and yaw (...) [rad] of M at times (...) [s]."""
        value = self._powers(time_s)[0]
        return value[..., :3], value[..., 3]

    def rate_at(self, time_s: ArrayLike) -> tuple[Array, Array]:
        """Velocity (..., 3) in W [m/s] of M's origin and turning rate (...) [rad/s] at times (...) [s]."""
        rate = self._powers(time_s)[1]
        return rate[..., :3], rate[..., 3]

    def _powers(self, time_s: ArrayLike) -> tuple[Array, Array]:
        time_s = np.asarray(time_s, dtype=np.float64)
        begin, end = self.knots_s[[0, -1]]
        since = time_s - begin
        if self.repeat == "loop":
            since = np.where(since > 0.0, np.mod(since, end - begin), since)
        under_way = (since >= 0.0) & (since < end - begin)
        t = begin + np.clip(since, 0.0, end - begin)
        k = np.clip(np.searchsorted(self.knots_s, t, side="right") - 1, 0, len(self.cubics) - 1)
        u, c = (t - self.knots_s[k])[..., None], self.cubics[k]
        value = c[..., 0] + u * (c[..., 1] + u * (c[..., 2] + u * c[..., 3]))
        rate = c[..., 1] + u * (2.0 * c[..., 2] + u * 3.0 * c[..., 3])
        return value, np.where(under_way[..., None], rate, 0.0)

    def to_dict(self) -> dict[str, Any]:
        """The `motion` entry of an obstacle."""
        points = [
            {"time_s": w.time_s, "position_m": list(w.position_m)} | ({"yaw_rad": w.yaw_rad} if w.yaw_rad else {})
            for w in self.way_points
        ]
        return {"repeat": self.repeat, "between": self.between, "way_points": points}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Motion:
        """Inverse of `to_dict`. Raises `InvalidScene`."""
        checks.mapping("motion", data, ("way_points",), ("repeat", "between"), InvalidScene)
        if not isinstance(data["way_points"], list | tuple):
            raise InvalidScene(f"motion way_points is {shown(data['way_points'])}: a list is needed")
        if len(data["way_points"]) > MOST_POINTS:
            raise InvalidScene(
                f"motion has {len(data['way_points']):,} way_points: at most {MOST_POINTS:,} are allowed"
            )
        points = tuple(_way_point(i, entry) for i, entry in enumerate(data["way_points"]))
        try:
            return cls(way_points=points, **{k: data[k] for k in ("repeat", "between") if k in data})
        except InvalidScene as error:
            raise InvalidScene(f"motion {error}") from None


def _way_point(index: int, entry: Any) -> WayPoint:
    where = f"motion way_points[{index}]"
    checks.mapping(where, entry, ("time_s", "position_m"), ("yaw_rad",), InvalidScene)
    try:
        return WayPoint(**entry)
    except InvalidScene as error:
        raise InvalidScene(f"{where} {error}") from None
