"""Composition of the benchmark set `moving20`: people and things that come in the way.

The shipped files are the set, fixed for good; this module says how they were drawn (by `tools/make_moving.py`) and
draws them again. Five kinds of four scenes each, by the speed of what moves, 0.2 to 1.2 m/s. A draw is kept when a
robot that walks on as if nothing moved would be hit, and one that knows all beforehand gets through
(`hotice.model.generate.passing`).
"""

from __future__ import annotations

import itertools
import math
import zlib
from collections.abc import Callable

import numpy as np

from hotice.errors import InvalidScene
from hotice.model.generate.passing import check_passing
from hotice.model.generate.pieces import either_side, wall
from hotice.model.geometry.shapes import BoxShape
from hotice.model.moving.motion import Motion, WayPoint
from hotice.model.moving.person import walking_person
from hotice.model.scene import Obstacle, Scene

NAME = "moving20"
BOUNDS_M = ((-0.5, -1.5, 0.0), (2.5, 1.5, 1.5))
SPEEDS_M_S = (0.2, 0.5, 0.8, 1.2)
USUAL_M_S, BEGIN_S = 0.65, 0.3
"""Mean speed of a student on its way, and when it begins to walk."""
HEEDLESS_M = 0.30
"""Radius of the robot that walks on: what comes nearer to its axis hits trunk or arms."""
MAX_DRAWS = 500
FAR_M = 1.8
"""Where walls end, aside, and people come from."""
Draw = Callable[[float, np.random.Generator], tuple[Obstacle, ...]]


def _usual_s(x: float) -> float:
    """When a robot that nothing hinders is at x [m]."""
    return BEGIN_S + x / USUAL_M_S


def _crossing(speed: float, rng: np.random.Generator) -> tuple[Obstacle, ...]:
    """One or two people cross the way where and when the robot would be there, give or take half a second."""
    people = []
    for i in range(int(rng.integers(1, 3))):
        side, x = either_side(rng), float(rng.uniform(0.8, 1.4))
        at_line = _usual_s(x) + float(rng.uniform(-0.5, 0.5)) + 0.3 * i
        ahead = float(rng.uniform(-0.3, 0.3))
        # as far aside as the speed makes it be at the start, but not all in view
        far = min(FAR_M, max(0.9, speed * at_line))
        start = max(0.0, at_line - far / speed)
        people += walking_person(f"person_{i + 1}", [(x, side * far), (x + ahead, -side * FAR_M)], speed, start_s=start)
    return tuple(people)


def _closing_gap(speed: float, rng: np.random.Generator) -> tuple[Obstacle, ...]:
    """Two leaves of a sliding door open, stay for about a second, and close, beginning somewhere between."""
    x, length = float(rng.uniform(0.9, 1.2)), 0.12
    wide, narrow = float(rng.uniform(1.2, 1.5)), float(rng.uniform(0.1, 0.4))
    stroke = 0.5 * (wide - narrow)
    # how far the leaves have come at first, and whether they are on their way to each other
    come, closing = stroke * float(rng.uniform(0.1, 0.9)), bool(rng.random() < 0.7)
    held = float(rng.uniform(0.6, 1.6)) * speed
    ends = [come, stroke, 0.0, 0.0, come] if closing else [come, 0.0, 0.0, stroke, come]
    way = [held if a == b else abs(b - a) for a, b in itertools.pairwise(ends)]
    course = list(zip(np.cumsum([0.0, *way]) / speed, ends, strict=True))
    leaves = []
    for name, side in (("left_leaf", 1.0), ("right_leaf", -1.0)):
        leaf = wall(name, x, length, side * (0.5 * wide - come), side * (0.5 * wide - come + FAR_M))
        y = leaf.position_m[1]
        points = [(t, x, y + side * (come - e), 0.0) for t, e in course]
        leaves.append(_moved(leaf, points, "loop"))
    return tuple(leaves)


def _swinging_door(speed: float, rng: np.random.Generator) -> tuple[Obstacle, ...]:
    """A door in a wall: shut, and somebody opens it, or open, and it falls shut and is opened again."""
    x, width, side = float(rng.uniform(0.9, 1.2)), float(rng.uniform(1.0, 1.2)), either_side(rng)
    walls = [wall(f"wall_{i + 1}", x, 0.1, s * 0.5 * width, s * FAR_M) for i, s in enumerate((1.0, -1.0))]
    hinge = (x, side * 0.5 * width, 0.0)
    leaf = Obstacle("door", "side", BoxShape((0.05, width - 0.04, 1.5)), (x, 0.0, 0.75))
    # the leaf's tip moves at the speed; it opens away from the robot, or towards it
    quarter = 0.5 * math.pi * width / speed
    open_ = side * 0.5 * math.pi * either_side(rng)
    if rng.random() < 0.5:
        begin = float(rng.uniform(0.05, 0.6))
        turns = [(0.0, 0.0), (begin, 0.0), (begin + quarter, open_)]
    else:
        shut = _usual_s(x) + float(rng.uniform(-0.8, 0.3))
        begin, held = max(0.05, shut - quarter), float(rng.uniform(0.1, 0.4))
        turns = [(0.0, open_), (begin, open_), (begin + quarter, 0.0), (begin + quarter + held, 0.0)]
        turns.append((turns[-1][0] + quarter, open_))
    course = Motion(way_points=tuple(WayPoint(time_s=t, position_m=hinge, yaw_rad=a) for t, a in turns))
    first = turns[0][1]
    # its pose at the first way point, from the shut one
    at_first = _turned(leaf, hinge, first)
    return (*walls, Obstacle(at_first.name, "side", leaf.shape, at_first.position_m, at_first.quaternion_wxyz, course))


def _pushed_box(speed: float, rng: np.random.Generator) -> tuple[Obstacle, ...]:
    """A crate or cart is pushed into the way, and stays there."""
    x, side = float(rng.uniform(0.9, 1.3)), either_side(rng)
    size = (float(rng.uniform(0.35, 0.6)), float(rng.uniform(0.35, 0.6)), float(rng.uniform(0.5, 1.1)))
    stop = side * float(rng.uniform(-0.1, 0.3))
    far = float(rng.uniform(0.9, 1.3))
    arrives = _usual_s(x) + float(rng.uniform(-0.8, 0.0))
    begin = max(0.0, arrives - abs(side * far - stop) / speed)
    box = Obstacle("crate", "side", BoxShape(size), (x, side * far, 0.5 * size[2]))
    way = abs(side * far - stop) / speed
    return (_moved(box, [(begin, x, side * far, 0.0), (begin + way, x, stop, 0.0)]),)


def _oncoming(speed: float, rng: np.random.Generator) -> tuple[Obstacle, ...]:
    """A person comes along a corridor towards the robot, a little to one side of the middle."""
    half, side = float(rng.uniform(1.05, 1.25)), either_side(rng)
    walls = tuple(
        Obstacle(f"wall_{i + 1}", "side", BoxShape((3.4, 0.1, 1.5)), (1.0, s * (half + 0.05), 0.75))
        for i, s in enumerate((1.0, -1.0))
    )
    y, end = side * float(rng.uniform(0.05, 0.4)), side * float(rng.uniform(0.05, 0.4))
    met = float(rng.uniform(0.8, 1.3))
    begin = met + speed * _usual_s(met)
    return (*walls, *walking_person("person", [(begin, y), (-1.5, end)], speed))


KINDS: dict[str, Draw] = {
    "crossing": _crossing,
    "closing_gap": _closing_gap,
    "swinging_door": _swinging_door,
    "pushed_box": _pushed_box,
    "oncoming": _oncoming,
}
ENTRIES = tuple((kind, speed) for kind in KINDS for speed in SPEEDS_M_S)
"""Kind and speed [m/s] of each scene, in order."""


def draw_moving(index: int) -> Scene:
    """Scene `index` of `moving20`. Raises `InvalidScene` where no draw serves."""
    kind, speed = ENTRIES[index]
    return draw_passable(kind, f"{NAME}/{index + 1:02d}_{kind}", speed, (zlib.crc32(NAME.encode()), index))[0]


def draw_passable(kind: str, title: str, speed_m_s: float, stream: tuple[int, ...]) -> tuple[Scene, list[str]]:
    """A scene of this kind with things that move at `speed_m_s`, and why earlier draws were not kept.

    Draw n takes its numbers from `stream` and n.

    Raises:
        InvalidScene: none of 500 draws serves.
    """
    rejected: list[str] = []
    for draw in range(MAX_DRAWS):
        rng = np.random.default_rng([*stream, draw])
        try:
            scene = Scene(title, BOUNDS_M, obstacles=tuple(KINDS[kind](speed_m_s, rng)))
        except InvalidScene as error:
            rejected.append(str(error))
            continue
        if not heedless_is_hit(scene):
            rejected.append("nothing comes in the way")
            continue
        passing = check_passing(scene)
        if passing.ok:
            return scene, rejected
        rejected.append(passing.reason)
    raise InvalidScene(f"scene {title!r}: none of {MAX_DRAWS} draws serves; the last: {rejected[-1]}")


def heedless_is_hit(scene: Scene) -> bool:
    """Whether a robot that walks straight to the goal, at its usual speed, is hit by something that moves."""
    start, goal = np.array(scene.start[:2]), np.array(scene.goal)
    length = float(np.linalg.norm(goal - start))
    for time_s in np.arange(0.0, _usual_s(length), 0.05):
        along = min(1.0, max(0.0, time_s - BEGIN_S) * USUAL_M_S / length)
        xy = start + along * (goal - start)
        column = np.array([[*xy, z] for z in (0.3, 0.6, 0.9, 1.2)])
        if any((o.at(float(time_s)).signed_distance(column) < HEEDLESS_M).any() for o in scene.moving):
            return True
    return False


def _moved(obstacle: Obstacle, points: list[tuple[float, float, float, float]], repeat: str = "once") -> Obstacle:
    """An obstacle with way points (time, x, y, yaw) of its own middle on the floor."""
    course = Motion(
        way_points=tuple(
            WayPoint(time_s=float(t), position_m=(x, float(y), 0.0), yaw_rad=yaw) for t, x, y, yaw in points
        ),
        repeat=repeat,
    )
    return Obstacle(
        obstacle.name, obstacle.category, obstacle.shape, obstacle.position_m, obstacle.quaternion_wxyz, course
    )


def _turned(obstacle: Obstacle, about: tuple[float, float, float], angle: float) -> Obstacle:
    """An obstacle turned about an upright axis."""
    turn = Motion(
        way_points=(WayPoint(time_s=0.0, position_m=about), WayPoint(time_s=10.0, position_m=about, yaw_rad=angle))
    )
    return Obstacle(
        obstacle.name, obstacle.category, obstacle.shape, obstacle.position_m, obstacle.quaternion_wxyz, turn
    ).at(10.0)
