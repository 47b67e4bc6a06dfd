"""Passage of a person-sized robot through a scene in which things move: a search over places and times.

The robot is an upright disc, `BODY_RADIUS_M` about the pelvis: trunk, arms, and a box of 30 cm held before it,
whichever way it heads. It walks at up to `WALK_M_S`, in any direction, stands whenever it likes, and must reach the
goal by `UNTIL_S`, half a second before a trial ends. Time goes in steps of 0.1 s, in each of which it moves by up to
two cells of 4 cm. A move is free when both of its ends keep `MARGIN_M` away from everything at the times at which the
robot is there and half a step later or before; the margin is for what happens in between. So a way found is one, and
none is faster than it says, but one that exists may be missed.

What this does not judge: postures, what lies on the floor to be stepped over, balance, and whether a robot that knows
movers only as its sensors see them could have known where to go: the search knows all motions beforehand.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hotice import checks
from hotice.checks import Range
from hotice.errors import InvalidScene
from hotice.model.generate.traversable import BORDER_M, MAX_PLACES, REACHED_M
from hotice.model.scene import Obstacle, Scene

BODY_RADIUS_M = 0.40
MARGIN_M = 0.03
WALK_M_S = 0.8
UNTIL_S = 4.5
STEP_S = 0.1
REACH = 2
"""Cells of a move."""
HEIGHTS_M = (0.2, 0.5, 0.8, 1.1, 1.3)
"""At which the disc is asked for its distance."""
_MOVES = tuple((i, j) for i, j in itertools.product(range(-REACH, REACH + 1), repeat=2) if i * i + j * j <= REACH**2)
Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Passing:
    """The outcome of `check_passing`.

    Attributes:
        ok: the goal is reached in time. reason: empty, or how far the robot comes.
        path: (n, 3) x, y [m] in W and time [s], as far as the search came when not ok.
        clearance_m: least distance between disc and obstacles along it.
        waiting_s: how long of it the robot stands.
    """

    ok: bool
    reason: str
    path: Array
    clearance_m: float
    waiting_s: float

    @property
    def arrival_s(self) -> float:
        """Time at its end."""
        return float(self.path[-1, 2])


def check_passing(
    scene: Scene,
    *,
    body_radius_m: float = BODY_RADIUS_M,
    speed_m_s: float = WALK_M_S,
    until_s: float = UNTIL_S,
) -> Passing:
    """A way from start to goal in space and time, the earliest. Raises `InvalidConfig` or `InvalidScene`."""
    checks.number("body_radius_m", body_radius_m, Range(above=0, most=2, unit="m"))
    checks.number("speed_m_s", speed_m_s, Range(least=0.1, most=5, unit="m/s"))
    checks.number("until_s", until_s, Range(above=0, most=120, unit="s"))
    cell = speed_m_s * STEP_S / REACH
    places, here = _places(scene, cell)
    columns = np.stack([np.concatenate([places, np.full((*places.shape[:2], 1), z)], axis=2) for z in HEIGHTS_M])
    still = scene.still().signed_distance(columns).min(axis=0)
    moving, least = scene.moving, body_radius_m + MARGIN_M

    def distance(time_s: float) -> Array:
        return np.minimum(still, _nearest(moving, columns, time_s))

    at_goal = np.linalg.norm(places - scene.goal, axis=2) <= REACHED_M
    start = np.zeros(still.shape, dtype=bool)
    start[here] = True
    rooms = [distance(0.0)]
    layers, left = [start & (rooms[0] >= least)], []
    while layers[-1].any() and not (layers[-1] & at_goal).any() and len(layers) * STEP_S <= until_s + 1e-9:
        half = distance((len(layers) - 0.5) * STEP_S) >= least
        room = distance(len(layers) * STEP_S)
        left.append(layers[-1] & half)
        layers.append(_spread(left[-1]) & half & (room >= least))
        rooms.append(room)
    return _outcome(scene, places, layers, left, rooms, at_goal, body_radius_m)


def _outcome(
    scene: Scene,
    places: Array,
    layers: list[NDArray[np.bool_]],
    left: list[NDArray[np.bool_]],
    rooms: list[Array],
    at_goal: NDArray[np.bool_],
    radius: float,
) -> Passing:
    """What the layers of reached places, of those that could be left, and the room there say."""
    ok = bool((layers[-1] & at_goal).any())
    last = max((k for k, layer in enumerate(layers) if layer.any()), default=-1)
    if last < 0:
        reason = "something stands too near to the start"
        return Passing(
            ok=False, reason=reason, path=np.array([[*scene.start[:2], 0.0]]), clearance_m=0.0, waiting_s=0.0
        )
    togo = np.where(layers[last] & (at_goal if ok else True), np.linalg.norm(places - scene.goal, axis=2), np.inf)
    cells = [np.unravel_index(int(togo.argmin()), togo.shape)]
    for places_left in reversed(left[:last]):
        cells.append(_before(places_left, cells[-1]))
    cells.reverse()
    path = np.array([[*places[c], k * STEP_S] for k, c in enumerate(cells)])
    clearance = min(float(rooms[k][c]) for k, c in enumerate(cells)) - radius
    reason = ""
    if not ok:
        x, y, t = path[-1]
        reason = f"no way in time: at {t:.1f} s at ({x:.2f}, {y:.2f}), {togo.min():.2f} m before the goal"
    stands = sum(a == b for a, b in itertools.pairwise(cells))
    return Passing(ok=ok, reason=reason, path=path, clearance_m=clearance, waiting_s=stands * STEP_S)


def _places(scene: Scene, cell: float) -> tuple[Array, tuple[int, int]]:
    """Places (nx, ny, 2) of the pelvis within the bounds, and the index of the start."""
    axes, here = [], []
    for axis in range(2):
        low, high = scene.bounds_m[0][axis], scene.bounds_m[1][axis]
        ends = scene.start[axis], scene.goal[axis]
        border = min(BORDER_M, min(ends) - low, high - max(ends))
        before = int((ends[0] - low - border) / cell + 1e-9)
        after = int((high - border - ends[0]) / cell + 1e-9)
        axes.append(ends[0] + cell * np.arange(-before, after + 1))
        here.append(before)
    if len(axes[0]) * len(axes[1]) > MAX_PLACES:
        raise InvalidScene(
            f"scene {scene.name!r} has {len(axes[0])} x {len(axes[1])} places to search, at most {MAX_PLACES:,} are "
            "allowed: crop it"
        )
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1), (here[0], here[1])


def _nearest(moving: tuple[Obstacle, ...], columns: Array, time_s: float) -> Array:
    """Distance (nx, ny) [m] of the upright disc's axis to what moves, at a time."""
    least = np.full(columns.shape[1:3], np.inf)
    for obstacle in moving:
        least = np.minimum(least, obstacle.at(time_s).signed_distance(columns).min(axis=0))
    return least


def _spread(reached: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Places that one move leads to."""
    nx, ny = reached.shape
    padded = np.pad(reached, REACH)
    result = np.zeros_like(reached)
    for i, j in _MOVES:
        result |= padded[REACH + i : REACH + i + nx, REACH + j : REACH + j + ny]
    return result


def _before(layer: NDArray[np.bool_], cell: tuple[np.intp, ...]) -> tuple[np.intp, ...]:
    """A reached place from which one move leads to a cell; the nearest, so that the robot waits late."""
    found = np.argwhere(layer)
    apart = ((found - np.array(cell)) ** 2).sum(axis=1)
    i, j = found[int(apart.argmin())]
    return i, j
