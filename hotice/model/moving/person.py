"""A walking person as an obstacle: a pair of upright capsules, legs and trunk with head, that share a motion."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

from hotice import checks
from hotice.checks import Range
from hotice.errors import InvalidScene
from hotice.model.geometry.shapes import CapsuleShape
from hotice.model.moving.motion import FASTEST_M_S, Motion, WayPoint
from hotice.model.scene import Obstacle

HEIGHT_M = 1.70
LEGS_RADIUS_M, TRUNK_RADIUS_M = 0.16, 0.22
"""Half widths of striding legs and of trunk with arms, of a person of `HEIGHT_M`; others in proportion."""
HIPS, WAIST = 0.56, 0.44
"""Upper end of the legs and lower end of the trunk, as shares of the height: the capsules overlap."""


def walking_person(
    name: str,
    places_m: Sequence[tuple[float, float]],
    speed_m_s: float,
    *,
    start_s: float = 0.0,
    repeat: str = "once",
    between: str = "linear",
    height_m: float = HEIGHT_M,
) -> tuple[Obstacle, Obstacle]:
    """Legs and trunk of a person who walks from place to place, facing the next one.

    Args:
        name: of the person; the obstacles are `NAME_legs` and `NAME_trunk`.
        places_m: two or more places x, y on the floor in W [m]; the person waits at the first until `start_s` [s].
        speed_m_s: mean speed between places. repeat, between: see `Motion`; a loop ends at its first place.
        height_m: 1.0 to 2.2 m.

    Raises:
        InvalidScene: fewer than two places, two in a row that are one, or numbers outside the allowed range.
    """
    motion = walk(places_m, speed_m_s, start_s=start_s, repeat=repeat, between=between)
    checks.number("height_m", height_m, Range(least=1.0, most=2.2, unit="m"), InvalidScene)
    x, y, _ = motion.way_points[0].position_m
    size = height_m / HEIGHT_M
    parts = []
    for part, radius, low, high in (
        ("legs", LEGS_RADIUS_M * size, 0.0, HIPS * height_m),
        ("trunk", TRUNK_RADIUS_M * size, WAIST * height_m, height_m),
    ):
        shape = CapsuleShape(radius, high - low - 2.0 * radius)
        parts.append(Obstacle(f"{name}_{part}", "side", shape, (x, y, 0.5 * (low + high)), motion=motion))
    return parts[0], parts[1]


def walk(
    places_m: Sequence[tuple[float, float]],
    speed_m_s: float,
    *,
    start_s: float = 0.0,
    repeat: str = "once",
    between: str = "linear",
) -> Motion:
    """Motion on the floor from place to place, x, y [m], at a mean speed, facing the next. Raises `InvalidScene`."""
    checks.number("speed_m_s", speed_m_s, Range(above=0, most=FASTEST_M_S, unit="m/s"), InvalidScene)
    legs = list(itertools.pairwise(places_m))
    if not legs:
        raise InvalidScene(f"{len(places_m)} places: two or more are needed to walk from one to another")
    time_s, points, yaw = start_s, [], None
    for i, (a, b) in enumerate(legs):
        length = math.dist(a, b)
        if not length:
            raise InvalidScene(f"places {i} and {i + 1} are both {tuple(a)}: give each place once in a row")
        ahead = math.atan2(b[1] - a[1], b[0] - a[0])
        # the short way round from the heading before
        yaw = ahead if yaw is None else yaw + math.remainder(ahead - yaw, 2.0 * math.pi)
        points.append(WayPoint(time_s=time_s, position_m=(*a, 0.0), yaw_rad=yaw))
        time_s += length / speed_m_s
    last = yaw if repeat != "loop" or yaw is None else yaw + math.remainder(points[0].yaw_rad - yaw, 2.0 * math.pi)
    points.append(WayPoint(time_s=time_s, position_m=(*legs[-1][1], 0.0), yaw_rad=last or 0.0))
    return Motion(way_points=tuple(points), repeat=repeat, between=between)
