"""Furnished rectangular rooms of a few types, drawn from recipes: what stands along walls, on the floor and hangs.

Room frame H: floor at z = 0, the room is 0 <= x <= length, 0 <= y <= width; a door in the wall x = 0 leads out.
All numbers are ours.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from hotice.model.generate import furniture as f
from hotice.model.generate.crop import OFF_LIMITS_M, SPACING_M, ClearanceMap
from hotice.model.geometry.extents import extent, union
from hotice.model.geometry.shapes import BoxShape
from hotice.model.scene import Obstacle

WALL_M, FRAME_M = 0.1, 0.05
"""Thickness of walls; width of door frames, which stand out of the wall by 2 cm."""
GAP_M = 0.03
"""Pieces keep this apart."""
BEYOND_M = 1.3
"""Length of floor behind the door [m]."""
TRIES = 25
HEIGHTS_M = (0.05, 0.3, 0.5, 0.75, 1.0, 1.25)

Array = NDArray[np.float64]
Placing = Callable[["Room", f.Piece], bool]


@dataclass(frozen=True, kw_only=True)
class Recipe:
    """Ranges of length and width [m] and rows of what a room holds: maker, placing, least and greatest number."""

    length_m: tuple[float, float]
    width_m: tuple[float, float]
    rows: tuple[tuple[f.Maker, Placing, int, int], ...]
    partition: bool = False
    """A wall with a second door divides the room across."""


@dataclass(kw_only=True)
class Room:
    """A room while it is furnished. `obstacles` in H; `taken`: boxes (2, 3) that further pieces keep out of."""

    rng: np.random.Generator
    length_m: float
    width_m: float
    doors: list[tuple[float, float, float]] = field(default_factory=list)
    """x of the wall, y of the middle, width."""
    obstacles: list[Obstacle] = field(default_factory=list)
    taken: list[Array] = field(default_factory=list)
    kinds: list[str] = field(default_factory=list)

    def add_door(self, x: float) -> None:
        """A wall across the room, in front of x, with a framed door; the floor before and behind it is kept clear."""
        width = self.rng.uniform(0.8, 1.0)
        y = self.rng.uniform(0.5 * width + 0.15, self.width_m - 0.5 * width - 0.15)
        name, number = "door", len(self.doors) + 1
        self.doors.append((x, y, width))
        half, frame = 0.5 * width, 0.5 * width + FRAME_M
        span, top = (x - WALL_M, x), (0.0, f.ROOM_HEIGHT_M)
        thick = (x - WALL_M - 0.02, x + 0.02)
        self._box(f"{name}{number}_right_wall", span, (-WALL_M, y - frame), top)
        self._box(f"{name}{number}_left_wall", span, (y + frame, self.width_m + WALL_M), top)
        self._box(f"{name}{number}_lintel", span, (y - frame, y + frame), (2.05, f.ROOM_HEIGHT_M))
        self._box(f"{name}{number}_right_frame", thick, (y - frame, y - half), (0.0, 2.05))
        self._box(f"{name}{number}_left_frame", thick, (y + half, y + frame), (0.0, 2.05))
        self.taken.append(np.array([[x - WALL_M - 0.7, y - half, 0.0], [x + 0.7, y + half, 2.0]]))

    def add_walls(self) -> None:
        """The three walls without a door."""
        low, top = -WALL_M, (0.0, f.ROOM_HEIGHT_M)
        self._box("right_wall", (low, self.length_m + WALL_M), (low, 0.0), top)
        self._box("left_wall", (low, self.length_m + WALL_M), (self.width_m, self.width_m + WALL_M), top)
        self._box("end_wall", (self.length_m, self.length_m + WALL_M), (0.0, self.width_m), top)

    def place(self, piece: f.Piece, x: float, y: float, yaw_rad: float) -> bool:
        """Puts the piece there unless it leaves the room or comes near to what is there."""
        parts = piece.at(f"{piece.kind}{self.kinds.count(piece.kind) + 1}", x, y, yaw_rad)
        low, high = box = union(extent(p) for p in parts)
        if low[:2].min() < 0.0 or high[0] > self.length_m or high[1] > self.width_m:
            return False
        if any((low < b[1] + GAP_M).all() and (b[0] < high + GAP_M).all() for b in self.taken):
            return False
        self.obstacles += parts
        self.taken.append(box)
        self.kinds.append(piece.kind)
        return True

    def clearance(self) -> ClearanceMap:
        """Clearance of the room and of the floor behind its door."""
        x = np.arange(-BEYOND_M, self.length_m + 0.5 * SPACING_M, SPACING_M)
        y = np.arange(0.0, self.width_m + 0.5 * SPACING_M, SPACING_M)
        floor = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1)
        built = [o for o in self.obstacles if o.name.endswith("_wall")]
        things = [o for o in self.obstacles if o not in built]
        to_built, to_things = np.ones(floor.shape[:2]), np.ones(floor.shape[:2])
        for height in HEIGHTS_M:
            p_H = np.concatenate([floor, np.full((*floor.shape[:2], 1), height)], axis=-1).reshape(-1, 3)
            to_built = np.minimum(to_built, distance(built, p_H).reshape(to_built.shape))
            to_things = np.minimum(to_things, distance(things, p_H).reshape(to_things.shape))
        nearest = np.minimum(to_built, to_things)
        for door_x, door_y, width in self.doors:
            off = np.abs(floor[..., 0] - door_x + 0.5 * WALL_M) < WALL_M
            if door_x == 0.0:
                off |= floor[..., 0] < -WALL_M
            nearest[off & (np.abs(floor[..., 1] - door_y) > 0.5 * width + 0.2)] = OFF_LIMITS_M
        return ClearanceMap(origin=floor[0, 0], nearest=nearest, things=to_things)

    def _box(self, name: str, x: tuple[float, float], y: tuple[float, float], z: tuple[float, float]) -> None:
        size, middle = (tuple(b - a for a, b in (x, y, z)), tuple(0.5 * (a + b) for a, b in (x, y, z)))
        category = "overhead" if z[0] > 1.0 else "side"
        self.obstacles.append(Obstacle(name, category, BoxShape(size), middle))  # type: ignore[arg-type]


def distance(obstacles: list[Obstacle], p_H: Array) -> Array:
    """Exact distance to the nearest obstacle, cut at 1 m, (n, 3) -> (n,) [m]."""
    result = np.ones(len(p_H))
    for obstacle in obstacles:
        centre, radius = obstacle.bounding_ball()
        near = np.flatnonzero(((p_H - centre) ** 2).sum(axis=1) < (result.clip(0.0) + radius) ** 2)
        if len(near):
            result[near] = np.minimum(result[near], obstacle.signed_distance(p_H[near]))
    return result


# ---- placing ---------------------------------------------------------------------------------------------------------


def wall(room: Room, piece: f.Piece) -> bool:
    """With its back to one of the walls."""
    half_x, half_y = 0.5 * np.ptp(piece.extent_m[:, :2], axis=0)
    for _ in range(TRIES):
        turns = int(room.rng.integers(4))
        run, across = (room.width_m, room.length_m) if turns % 2 == 0 else (room.length_m, room.width_m)
        free = 0.5 * run - half_y - GAP_M
        if free <= 0.0:
            continue
        along = 0.5 * run + room.rng.uniform(-free, free)
        inward = half_x + GAP_M + room.rng.uniform(0.001, 0.03)
        if turns >= 2:
            inward = across - inward
        x, y = (inward, along) if turns % 2 == 0 else (along, inward)
        if room.place(piece, x, y, turns * 0.5 * math.pi):
            return True
    return False


def floor(room: Room, piece: f.Piece) -> bool:
    """Anywhere, turned at will when it is small, else along the walls with up to 10 degrees of disorder."""
    small = np.ptp(piece.extent_m[:, :2], axis=0).max() < 0.8
    for _ in range(TRIES):
        x, y = room.rng.uniform(0.3, room.length_m - 0.3), room.rng.uniform(0.3, room.width_m - 0.3)
        turn = room.rng.uniform(-math.pi, math.pi) if small else room.rng.integers(4) * 0.5 * math.pi
        if room.place(piece, x, y, turn + (0.0 if small else math.radians(room.rng.uniform(-10.0, 10.0)))):
            return True
    return False


RECIPES: dict[str, Recipe] = {
    "living": Recipe(
        length_m=(4.2, 5.5),
        width_m=(3.6, 4.6),
        rows=(
            (f.sofa_set, wall, 1, 1),
            (f.sideboard, wall, 1, 1),
            (f.shelf, wall, 0, 2),
            (f.floor_lamp, wall, 0, 2),
            (f.armchair, floor, 0, 1),
            (f.plant, wall, 0, 2),
            (f.pendant, floor, 0, 2),
            (f.stool, floor, 0, 1),
            (f.wall_shelf, wall, 0, 1),
            (f.books, floor, 0, 3),
            (f.ball, floor, 0, 3),
            (f.cable_duct, floor, 0, 1),
        ),
    ),
    "dining": Recipe(
        length_m=(4.0, 5.2),
        width_m=(3.6, 4.4),
        rows=(
            (f.dining_set, floor, 1, 1),
            (f.sideboard, wall, 1, 1),
            (f.shelf, wall, 0, 1),
            (f.plant, wall, 0, 2),
            (f.pendant, floor, 1, 2),
            (f.chair, wall, 0, 2),
            (f.carton, floor, 0, 2),
            (f.bag, floor, 0, 2),
        ),
    ),
    "office": Recipe(
        length_m=(4.5, 6.0),
        width_m=(3.8, 4.8),
        rows=(
            (f.desk_set, wall, 2, 4),
            (f.shelf, wall, 1, 2),
            (f.rack, wall, 0, 1),
            (f.plant, wall, 0, 1),
            (f.office_chair, floor, 0, 1),
            (f.round_table, floor, 0, 1),
            (f.cable_duct, floor, 1, 3),
            (f.carton, floor, 0, 3),
            (f.bag, floor, 0, 2),
            (f.pendant, floor, 0, 1),
        ),
    ),
    "bedroom": Recipe(
        length_m=(3.8, 4.8),
        width_m=(3.4, 4.2),
        rows=(
            (f.bed_set, wall, 1, 1),
            (f.wardrobe, wall, 1, 1),
            (f.chair, wall, 0, 1),
            (f.floor_lamp, wall, 0, 1),
            (f.wall_shelf, wall, 0, 1),
            (f.nightstand, wall, 0, 1),
            (f.shoes, floor, 0, 3),
            (f.bag, floor, 0, 2),
            (f.books, floor, 0, 2),
            (f.pendant, floor, 0, 1),
        ),
    ),
    "storage": Recipe(
        length_m=(3.8, 5.5),
        width_m=(2.8, 4.0),
        rows=(
            (f.rack, wall, 2, 5),
            (f.wardrobe, wall, 0, 1),
            (f.carton, floor, 2, 7),
            (f.bag, floor, 0, 2),
            (f.broom, floor, 0, 2),
            (f.stool, floor, 0, 1),
            (f.wall_shelf, wall, 0, 2),
            (f.pendant, floor, 0, 2),
            (f.cable_duct, floor, 0, 2),
        ),
    ),
    "hallway": Recipe(
        length_m=(4.5, 6.5),
        width_m=(1.7, 2.2),
        partition=True,
        rows=(
            (f.shelf, wall, 0, 1),
            (f.wall_shelf, wall, 0, 2),
            (f.plant, wall, 0, 1),
            (f.stool, wall, 0, 1),
            (f.pendant, floor, 0, 2),
            (f.shoes, wall, 0, 2),
            (f.bag, wall, 0, 1),
            (f.carton, wall, 0, 1),
            (f.books, floor, 0, 1),
            (f.cable_duct, floor, 0, 1),
        ),
    ),
}


def furnish(kind: str, density: float, rng: np.random.Generator) -> Room:
    """A room by recipe; `density` in 0..1 moves the numbers of pieces from least to greatest on average."""
    recipe = RECIPES[kind]
    room = Room(rng=rng, length_m=rng.uniform(*recipe.length_m), width_m=rng.uniform(*recipe.width_m))
    room.add_walls()
    room.add_door(0.0)
    if recipe.partition:
        room.add_door(room.length_m * rng.uniform(0.4, 0.6))
    room.taken += [extent(o) for o in room.obstacles]
    for maker, placing, least, most in recipe.rows:
        for _ in range(least + int(rng.binomial(most - least, density))):
            placing(room, maker(rng))
    return room
