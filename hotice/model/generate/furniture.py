"""Parametric furniture: each piece a few primitives with the proportions of real ones.

A piece stands in its own frame F: floor at z = 0, footprint centred at the origin, back towards -x (to a wall), front
towards +x. Every maker draws its sizes from the ranges written in it; all numbers are ours, taken from common
furniture sizes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hotice.model.frames import quat_from_yaw, quat_mul, quat_rotate
from hotice.model.geometry.extents import category_by_height, extent, union
from hotice.model.geometry.shapes import BoxShape, CapsuleShape, CylinderShape, Shape, SphereShape
from hotice.model.scene import Obstacle

ALONG_X = (math.sqrt(0.5), 0.0, math.sqrt(0.5), 0.0)
ALONG_Y = (math.sqrt(0.5), math.sqrt(0.5), 0.0, 0.0)
"""Orientations wxyz that lay a cylinder or capsule along x or y."""
UPRIGHT = (1.0, 0.0, 0.0, 0.0)
ROOM_HEIGHT_M = 2.4

Rng = np.random.Generator
Parts = list[Obstacle]


@dataclass(frozen=True)
class Piece:
    """A piece of furniture in its own frame F; its `parts` share the category that follows from its height."""

    kind: str
    parts: tuple[Obstacle, ...]

    @property
    def extent_m(self) -> NDArray[np.float64]:
        """Lowest and highest corner in F, (2, 3) [m]."""
        return union(extent(p) for p in self.parts)

    def at(self, name: str, x: float, y: float, yaw_rad: float) -> list[Obstacle]:
        """The parts in a frame W where F lies at x, y [m], turned by `yaw_rad`; they are named `<name>_<part>`."""
        quat_WF = quat_from_yaw(yaw_rad)
        return [
            replace(
                part,
                name=f"{name}_{part.name}",
                position_m=tuple((quat_rotate(quat_WF, part.position_m) + [x, y, 0.0]).tolist()),
                quaternion_wxyz=tuple(quat_mul(quat_WF, part.quaternion_wxyz).tolist()),
            )
            for part in self.parts
        ]


Maker = Callable[[Rng], Piece]


def _piece(kind: str, *parts: Obstacle | Sequence[Obstacle]) -> Piece:
    """Joins parts, centres the footprint and gives all of them the category of the whole."""
    flat = [p for part in parts for p in ([part] if isinstance(part, Obstacle) else part)]
    low, high = union(extent(p) for p in flat)
    category = category_by_height(low[2], high[2])
    return _centred(kind, [replace(p, category=category) for p in flat])


def _centred(kind: str, parts: Sequence[Obstacle]) -> Piece:
    low, high = union(extent(p) for p in parts)
    shift = np.array([*(-0.5 * (low + high)[:2]), 0.0])
    return Piece(kind, tuple(replace(p, position_m=tuple((shift + p.position_m).tolist())) for p in parts))


def _part(name: str, shape: Shape, x: float, y: float, z: float, quat=UPRIGHT) -> Obstacle:
    """A part centred at x, y, z."""
    return Obstacle(name, "side", shape, (x, y, z), quat)


def _box(name: str, x: tuple[float, float], y: tuple[float, float], z: tuple[float, float]) -> Obstacle:
    """A box from its extents."""
    spans = (x, y, z)
    return _part(name, BoxShape(tuple(b - a for a, b in spans)), *(0.5 * (a + b) for a, b in spans))  # type: ignore[arg-type]


def _pole(name: str, radius: float, z: tuple[float, float], x: float = 0.0, y: float = 0.0) -> Obstacle:
    """An upright cylinder between two heights."""
    return _part(name, CylinderShape(radius, z[1] - z[0]), x, y, 0.5 * (z[0] + z[1]))


def _span(width: float, centre: float = 0.0) -> tuple[float, float]:
    return centre - 0.5 * width, centre + 0.5 * width


def _legs(depth: float, width: float, height: float, thick: float, round_legs: bool = False) -> Parts:
    """Four legs inside a footprint centred at the origin."""
    x, y = 0.5 * (depth - thick), 0.5 * (width - thick)
    corners = ((x, y), (x, -y), (-x, -y), (-x, y))
    if round_legs:
        return [_pole(f"leg_{i}", 0.5 * thick, (0.0, height), *c) for i, c in enumerate(corners, 1)]
    return [
        _box(f"leg_{i}", _span(thick, cx), _span(thick, cy), (0.0, height)) for i, (cx, cy) in enumerate(corners, 1)
    ]


# ---- tables ----------------------------------------------------------------------------------------------------------


def table(rng: Rng) -> Piece:
    """A dining table on four legs, 72 to 76 cm high."""
    x, y, height = rng.uniform(0.75, 0.95), rng.uniform(1.4, 2.0), rng.uniform(0.72, 0.76)
    thick = rng.uniform(0.025, 0.04)
    top = _box("top", _span(x), _span(y), (height - thick, height))
    return _piece("table", top, _legs(x, y, height - thick, rng.uniform(0.05, 0.08)))


def round_table(rng: Rng) -> Piece:
    """A round table on a central foot, 0.9 to 1.2 m across."""
    radius, height = rng.uniform(0.45, 0.60), rng.uniform(0.72, 0.76)
    return _piece(
        "round_table",
        _pole("top", radius, (height - 0.03, height)),
        _pole("column", 0.05, (0.02, height - 0.03)),
        _pole("foot", 0.5 * radius, (0.0, 0.02)),
    )


def coffee_table(rng: Rng) -> Piece:
    """A low table, 35 to 48 cm high."""
    x, y, height = rng.uniform(0.5, 0.65), rng.uniform(0.8, 1.2), rng.uniform(0.35, 0.48)
    top = _box("top", _span(x), _span(y), (height - 0.03, height))
    return _piece("coffee_table", top, _legs(x, y, height - 0.03, 0.05, round_legs=True))


def desk(rng: Rng) -> Piece:
    """A desk with two side panels and a back panel; sometimes a screen stands on it."""
    x, y, height = rng.uniform(0.6, 0.8), rng.uniform(1.1, 1.6), rng.uniform(0.70, 0.76)
    parts = [_box("top", _span(x), _span(y), (height - 0.03, height))]
    for name, side in (("left", 1), ("right", -1)):
        parts.append(_box(f"{name}_panel", _span(x - 0.06), _span(0.03, side * (0.5 * y - 0.05)), (0.0, height - 0.03)))
    parts.append(_box("back_panel", _span(0.02, -0.5 * x + 0.1), _span(y - 0.13), (0.35, height - 0.03)))
    if rng.random() < 0.6:
        at = rng.uniform(-0.2, 0.2) * y
        parts.append(_box("screen_foot", _span(0.18, -0.12), _span(0.2, at), (height, height + 0.1)))
        parts.append(
            _box("screen", _span(0.05, -0.15), _span(rng.uniform(0.5, 0.7), at), (height + 0.1, height + 0.48))
        )
    return _piece("desk", parts)


# ---- seats -----------------------------------------------------------------------------------------------------------


def chair(rng: Rng) -> Piece:
    """A chair with four legs, its back towards -x."""
    x, y, seat = rng.uniform(0.40, 0.46), rng.uniform(0.40, 0.48), rng.uniform(0.43, 0.47)
    back = _box(
        "back", (-0.5 * x, -0.5 * x + 0.03), _span(y), (seat + rng.uniform(0.05, 0.15), rng.uniform(0.82, 0.98))
    )
    posts = [
        _box(f"post_{i}", (-0.5 * x, -0.5 * x + 0.03), _span(0.03, s * (0.5 * y - 0.015)), (seat, back.position_m[2]))
        for i, s in enumerate((1, -1), 1)
    ]
    return _piece(
        "chair", _box("seat", _span(x), _span(y), (seat - 0.04, seat)), back, posts, _legs(x, y, seat - 0.04, 0.04)
    )


def office_chair(rng: Rng) -> Piece:
    """A swivel chair on a star of two crossed bars, with arm rests at times."""
    half, seat = rng.uniform(0.23, 0.26), rng.uniform(0.44, 0.52)
    bar = CapsuleShape(0.03, rng.uniform(0.50, 0.58))
    parts = [_part("foot_x", bar, 0.0, 0.0, 0.06, ALONG_X), _part("foot_y", bar, 0.0, 0.0, 0.06, ALONG_Y)]
    parts += [
        _pole("column", 0.03, (0.09, seat - 0.07)),
        _box("seat", _span(2 * half), _span(2 * half), (seat - 0.07, seat)),
    ]
    parts.append(_box("back", (-half, -half + 0.06), _span(0.44), (seat + 0.08, seat + rng.uniform(0.45, 0.65))))
    parts.append(_box("back_post", (-half, -half + 0.06), _span(0.08), (seat, seat + 0.08)))
    if rng.random() < 0.5:
        for name, side in (("left", 1), ("right", -1)):
            parts.append(
                _box(f"{name}_arm", _span(0.25), _span(0.05, side * (half + 0.025)), (seat - 0.05, seat + 0.22))
            )
    return _piece("office_chair", parts)


def stool(rng: Rng) -> Piece:
    """A round stool."""
    radius, height = rng.uniform(0.15, 0.2), rng.uniform(0.42, 0.65)
    legs = _legs(1.4 * radius, 1.4 * radius, height - 0.04, 0.03, round_legs=True)
    return _piece("stool", _pole("seat", radius, (height - 0.04, height)), legs)


def sofa(rng: Rng, width: tuple[float, float] = (1.5, 2.2)) -> Piece:
    """A sofa with back and arms."""
    x, y, seat = rng.uniform(0.8, 0.95), rng.uniform(*width), rng.uniform(0.38, 0.45)
    arm = rng.uniform(0.12, 0.2)
    sides = [
        _box(f"{n}_arm", _span(x), _span(arm, s * 0.5 * (y - arm)), (0.06, seat + 0.18))
        for n, s in (("left", 1), ("right", -1))
    ]
    back = _box("back", (-0.5 * x, -0.5 * x + 0.2), _span(y - 2 * arm), (seat, rng.uniform(0.75, 0.88)))
    return _piece(
        "sofa",
        _box("seat", _span(x), _span(y - 2 * arm), (0.06, seat)),
        back,
        sides,
        _legs(x - 0.1, y - 0.1, 0.06, 0.05),
    )


def armchair(rng: Rng) -> Piece:
    """A sofa for one."""
    return replace(sofa(rng, (0.75, 0.9)), kind="armchair")


# ---- storage ---------------------------------------------------------------------------------------------------------


def shelf(rng: Rng) -> Piece:
    """An open bookcase with side panels, boards and a back."""
    x, y, height = rng.uniform(0.28, 0.40), rng.uniform(0.6, 1.2), rng.uniform(1.2, 2.1)
    parts = [_box("back", (-0.5 * x, -0.5 * x + 0.01), _span(y), (0.0, height))]
    for name, side in (("left", 1), ("right", -1)):
        parts.append(_box(f"{name}_panel", _span(x), _span(0.02, side * 0.5 * (y - 0.02)), (0.0, height)))
    levels = np.linspace(0.04, height - 0.025, int(rng.integers(4, 7)))
    parts += [_box(f"board_{i}", _span(x), _span(y - 0.04), (z, z + 0.025)) for i, z in enumerate(levels, 1)]
    return _piece("shelf", parts)


def rack(rng: Rng) -> Piece:
    """A storage rack of four posts and boards, with boxes on it."""
    x, y, height = rng.uniform(0.4, 0.6), rng.uniform(0.9, 1.6), rng.uniform(1.6, 2.0)
    parts = _legs(x, y, height, 0.04)
    levels = np.linspace(0.1, height - 0.04, int(rng.integers(3, 6)))
    for i, z in enumerate(levels, 1):
        parts.append(_box(f"board_{i}", _span(x), _span(y), (z, z + 0.03)))
    for i, z in enumerate(levels[:-1], 1):
        wide, deep, tall = rng.uniform(0.2, 0.4), rng.uniform(0.2, x), rng.uniform(0.15, 0.3)
        at = rng.uniform(-1.0, 1.0) * 0.5 * (y - wide)
        parts.append(_box(f"load_{i}", _span(deep), _span(wide, at), (z + 0.03, z + 0.03 + tall)))
    return _piece("rack", parts)


def wardrobe(rng: Rng) -> Piece:
    """A closed cupboard, 1.8 to 2.2 m high."""
    return _piece("wardrobe", _box("body", _span(0.6), _span(rng.uniform(0.8, 1.8)), (0.0, rng.uniform(1.8, 2.2))))


def sideboard(rng: Rng) -> Piece:
    """A low cupboard on a plinth or on legs; sometimes with a screen on it."""
    x, y = rng.uniform(0.38, 0.45), rng.uniform(1.0, 1.8)
    height, foot = rng.uniform(0.45, 0.85), rng.uniform(0.06, 0.15)
    parts = [_box("body", _span(x), _span(y), (foot, height)), *_legs(x - 0.04, y - 0.04, foot, 0.04)]
    if rng.random() < 0.5:
        parts.append(_box("screen", _span(0.05), _span(min(rng.uniform(0.9, 1.4), y)), (height + 0.05, height + 0.75)))
        parts.append(_box("screen_foot", _span(0.22), _span(0.4), (height, height + 0.05)))
    return _piece("sideboard", parts)


def nightstand(rng: Rng) -> Piece:
    """A small chest."""
    return _piece("nightstand", _box("body", _span(rng.uniform(0.35, 0.42)), _span(rng.uniform(0.4, 0.5)), (0.0, 0.5)))


def bed(rng: Rng) -> Piece:
    """A bed with its head towards -x."""
    x, y, height = rng.uniform(1.95, 2.1), rng.choice([0.9, 1.4, 1.6]), rng.uniform(0.42, 0.55)
    head = _box("head", (-0.5 * x, -0.5 * x + 0.06), _span(y), (0.0, rng.uniform(0.8, 1.1)))
    mattress = _box("mattress", (-0.5 * x + 0.06, 0.5 * x), _span(y), (0.18, height))
    return _piece("bed", head, mattress, _legs(x, y, 0.18, 0.06))


# ---- lamps and plants ------------------------------------------------------------------------------------------------


def floor_lamp(rng: Rng) -> Piece:
    """A standing lamp, 1.4 to 1.7 m high."""
    height, shade = rng.uniform(1.4, 1.7), rng.uniform(0.14, 0.22)
    return _piece(
        "floor_lamp",
        _pole("foot", rng.uniform(0.12, 0.16), (0.0, 0.025)),
        _pole("column", 0.015, (0.025, height - 0.25)),
        _pole("shade", shade, (height - 0.25, height)),
    )


def pendant(rng: Rng) -> Piece:
    """A lamp on a cord, its lower end 1.12 to 1.4 m above the floor, as over tables and in low rooms."""
    low, radius = rng.uniform(1.12, 1.4), rng.uniform(0.12, 0.22)
    if rng.random() < 0.5:
        shade, top = _part("shade", SphereShape(radius), 0.0, 0.0, low + radius), low + 2 * radius
    else:
        top = low + rng.uniform(0.15, 0.25)
        shade = _pole("shade", radius, (low, top))
    return _piece("pendant", shade, _pole("cord", 0.01, (top, ROOM_HEIGHT_M)))


def wall_shelf(rng: Rng) -> Piece:
    """A board with things on it, on the wall at head height."""
    x, y, low = rng.uniform(0.2, 0.3), rng.uniform(0.6, 1.2), rng.uniform(1.15, 1.35)
    parts = [_box("board", _span(x), _span(y), (low, low + 0.03))]
    parts.append(_box("books", _span(0.8 * x), _span(rng.uniform(0.3, 0.9) * y), (low + 0.03, low + 0.28)))
    return _piece("wall_shelf", parts)


def plant(rng: Rng) -> Piece:
    """A plant in a pot, 0.5 to 1.4 m high."""
    pot, height, leaves = rng.uniform(0.12, 0.2), rng.uniform(0.25, 0.4), rng.uniform(0.2, 0.32)
    middle = height + leaves * rng.uniform(0.8, 2.0)
    stem = _pole("stem", 0.02, (height, middle))
    return _piece("plant", _pole("pot", pot, (0.0, height)), stem, _part("leaves", SphereShape(leaves), 0, 0, middle))


# ---- on the floor ----------------------------------------------------------------------------------------------------


def carton(rng: Rng) -> Piece:
    """A cardboard box, 15 to 45 cm high."""
    x, y = rng.uniform(0.25, 0.5, 2)
    return _piece("carton", _box("body", _span(x), _span(y), (0.0, rng.uniform(0.15, 0.45))))


def books(rng: Rng) -> Piece:
    """A stack of books, 3 to 12 cm high."""
    x, y = rng.uniform(0.18, 0.3, 2)
    return _piece("books", _box("stack", _span(x), _span(y), (0.0, rng.uniform(0.03, 0.12))))


def shoes(rng: Rng) -> Piece:
    """A pair of shoes."""
    length, apart = rng.uniform(0.16, 0.2), rng.uniform(0.12, 0.2)
    shoe = CapsuleShape(0.045, length)
    return _piece("shoes", *(_part(f"shoe_{i}", shoe, 0, s * apart / 2, 0.045, ALONG_X) for i, s in ((1, 1), (2, -1))))


def ball(rng: Rng) -> Piece:
    """A ball, 6 to 24 cm across."""
    radius = rng.uniform(0.03, 0.12)
    return _piece("ball", _part("ball", SphereShape(radius), 0.0, 0.0, radius))


def bag(rng: Rng) -> Piece:
    """A soft bag that lies on its side."""
    radius = rng.uniform(0.09, 0.16)
    return _piece("bag", _part("body", CapsuleShape(radius, rng.uniform(0.2, 0.4)), 0.0, 0.0, radius, ALONG_Y))


def cable_duct(rng: Rng) -> Piece:
    """A flat duct on the floor, 2 to 4 cm high."""
    duct = _box("duct", _span(rng.uniform(0.06, 0.12)), _span(rng.uniform(0.6, 1.4)), (0.0, rng.uniform(0.02, 0.04)))
    return _piece("cable_duct", duct)


def broom(rng: Rng) -> Piece:
    """A broom that fell over."""
    stick = _part("stick", CapsuleShape(0.0125, rng.uniform(1.0, 1.3)), 0.0, 0.0, 0.04, ALONG_Y)
    end = stick.position_m[1] + 0.5 * stick.shape.length_m  # type: ignore[attr-defined]
    return _piece("broom", stick, _box("brush", _span(0.3), _span(0.06, end), (0.0, 0.08)))


# ---- groups ----------------------------------------------------------------------------------------------------------


def group(kind: str, *members: tuple[Piece, float, float, float]) -> Piece:
    """One piece of several (piece, x, y, yaw); parts are named `<piece><number>_<part>`."""
    placed = (p.at(f"{p.kind}{i}", x, y, yaw) for i, (p, x, y, yaw) in enumerate(members, 1))
    return _centred(kind, [part for parts in placed for part in parts])


def dining_set(rng: Rng) -> Piece:
    """A table with two to six chairs, drawn out by 0 to 25 cm and turned a little."""
    if rng.random() < 0.3:
        middle = round_table(rng)
        reach = 0.5 * np.ptp(middle.extent_m[:, 0])
        seats = [(reach, angle) for angle in np.arange(4) * 0.5 * math.pi + rng.uniform(-0.2, 0.2)]
        places = [(r * math.cos(a), r * math.sin(a), a) for r, a in seats]
    else:
        middle = table(rng)
        half_x, half_y = 0.5 * np.ptp(middle.extent_m[:, :2], axis=0)
        places = [(s * half_x, y, 0.0 if s > 0 else math.pi) for s in (1, -1) for y in (0.45 * half_y, -0.45 * half_y)]
        places += [(0.0, s * half_y, s * 0.5 * math.pi) for s in (1, -1)]
    chosen = rng.permutation(len(places))[: int(rng.integers(2, len(places) + 1))]
    members = [(middle, 0.0, 0.0, 0.0)]
    for i in chosen:
        x, y, out = places[i]
        seat, draw = chair(rng), 0.12 + rng.uniform(0.0, 0.25)
        members.append(
            (seat, x + draw * math.cos(out), y + draw * math.sin(out), out + math.pi + rng.uniform(-0.15, 0.15))
        )
    return group("dining_set", *members)


def sofa_set(rng: Rng) -> Piece:
    """A sofa, a coffee table before it and sometimes an armchair at its side."""
    seat, low = sofa(rng), coffee_table(rng)
    front = 0.5 * np.ptp(seat.extent_m[:, 0])
    gap = rng.uniform(0.3, 0.5)
    x_low = front + gap + 0.5 * np.ptp(low.extent_m[:, 0])
    members = [(seat, 0.0, 0.0, 0.0), (low, x_low, rng.uniform(-0.2, 0.2), 0.0)]
    if rng.random() < 0.6:
        side = rng.choice([-1.0, 1.0])
        members.append((armchair(rng), x_low, side * rng.uniform(1.3, 1.55), -side * 0.5 * math.pi))
    return group("sofa_set", *members)


def desk_set(rng: Rng) -> Piece:
    """A desk and an office chair before it, turned at will."""
    work, seat = desk(rng), office_chair(rng)
    x = 0.5 * np.ptp(work.extent_m[:, 0]) + rng.uniform(0.42, 0.6)
    return group("desk_set", (work, 0.0, 0.0, 0.0), (seat, x, rng.uniform(-0.2, 0.2), math.pi + rng.uniform(-0.6, 0.6)))


def bed_set(rng: Rng) -> Piece:
    """A bed with one or two nightstands at its head."""
    lying = bed(rng)
    low, high = lying.extent_m
    sides = [1.0, -1.0] if rng.random() < 0.6 else [rng.choice([-1.0, 1.0])]
    members = [(lying, 0.0, 0.0, 0.0)]
    for side in sides:
        stand = nightstand(rng)
        members.append((stand, low[0] - stand.extent_m[0, 0], side * (high[1] + stand.extent_m[1, 1] + 0.05), 0.0))
    return group("bed_set", *members)
