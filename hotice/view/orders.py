"""Orders from the browser: what a page may ask of the simulation. It comes from outside, and is checked here."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, cast

from hotice import checks
from hotice.checks import Range
from hotice.documents import parse_json
from hotice.errors import HoticeError
from hotice.model.objects import CarriedObject, object_from_dict
from hotice.model.scene import Scene, Vec3

MOST_BYTES = 4096
"""Longest order."""
BEYOND_M = 0.5
"""So far beyond the scene's bounds an obstacle may be put [m] (ours)."""
FASTEST_PUSH = Range(least=-1.5, most=1.5, unit="m/s")
"""Change of velocity along each axis (ours; policies are trained with pushes of up to 0.5 m/s)."""
EXTENT = Range(least=0.05, most=0.6, unit="m")
MASS = Range(least=0.1, most=6.0, unit="kg")
FIELDS = ("none", "sgf", "ogf")


class InvalidOrder(HoticeError):
    """An order that is none, or asks for what is not there."""


@dataclass(frozen=True, kw_only=True)
class Move:
    """Bring an obstacle to a place in W [m]."""

    obstacle: str
    to_W: Vec3


@dataclass(frozen=True, kw_only=True)
class Push:
    """Change the pelvis' horizontal velocity at once, (2,) in W [m/s]."""

    velocity_W: tuple[float, float]


@dataclass(frozen=True, kw_only=True)
class Take:
    """Begin anew with another object."""

    carried: CarriedObject


@dataclass(frozen=True, kw_only=True)
class UsePolicy:
    """Begin anew with another policy, by its name."""

    policy: str


@dataclass(frozen=True, kw_only=True)
class Noise:
    """Begin anew with or without noise and delays."""

    on: bool


@dataclass(frozen=True, kw_only=True)
class Pause:
    """Let the robot stand still in time, or go on."""

    on: bool


@dataclass(frozen=True, kw_only=True)
class Restart:
    """Put the robot at its start; obstacles stay where they are."""


@dataclass(frozen=True, kw_only=True)
class Restore:
    """Bring all obstacles back to where the scene has them."""


@dataclass(frozen=True, kw_only=True)
class Slice:
    """Show a horizontal slice of a field, "none", "sgf" or "ogf", at a height [m]."""

    field: str
    height_m: float


Order = Move | Push | Take | UsePolicy | Noise | Pause | Restart | Restore | Slice


@dataclass(frozen=True, kw_only=True)
class Known:
    """What orders may name: obstacles and bounds of a scene, and policies."""

    scene: Scene
    policies: tuple[str, ...]


def read_order(content: bytes, known: Known) -> Order:
    """The order in a JSON text. Raises `HoticeError` for anything that is not exactly an order."""
    said = parse_json("order", content, InvalidOrder)
    if not isinstance(said, dict):
        raise InvalidOrder(f"order is {checks.shown(said)}: an object with the key order is needed")
    name = checks.one_of("order", said.get("order"), _READERS, InvalidOrder)
    keys, read = _READERS[name]
    checks.mapping(f"order {name}", said, ("order", *keys), error=InvalidOrder)
    return read(said, known)


def _move(said: Mapping[str, Any], known: Known) -> Move:
    names = [obstacle.name for obstacle in known.scene.obstacles]
    obstacle = checks.one_of("obstacle", said["obstacle"], names, InvalidOrder)
    to_W = checks.vector("to", said["to"], 3, error=InvalidOrder)
    for axis, low, high, value in zip("xyz", *known.scene.bounds_m, to_W, strict=True):
        checks.number(f"to {axis}", value, Range(least=low - BEYOND_M, most=high + BEYOND_M, unit="m"), InvalidOrder)
    return Move(obstacle=obstacle, to_W=cast(Vec3, to_W))


def _push(said: Mapping[str, Any], _: Known) -> Push:
    x, y = checks.vector("velocity", said["velocity"], 2, FASTEST_PUSH, InvalidOrder)
    return Push(velocity_W=(x, y))


def _take(said: Mapping[str, Any], _: Known) -> Take:
    carried = object_from_dict(said["object"])
    for axis, half in zip("xyz", carried.half_extents_m.tolist(), strict=True):
        checks.number(f"extent of the object along {axis}", 2.0 * half, EXTENT, InvalidOrder)
    checks.number("mass of the object", carried.mass_kg, MASS, InvalidOrder)
    return Take(carried=carried)


def _slice(said: Mapping[str, Any], known: Known) -> Slice:
    low, high = (corner[2] for corner in known.scene.bounds_m)
    height = checks.number("height", said["height"], Range(least=low, most=high, unit="m"), InvalidOrder)
    return Slice(field=checks.one_of("field", said["field"], FIELDS, InvalidOrder), height_m=height)


_READERS: dict[str, tuple[tuple[str, ...], Callable[[Mapping[str, Any], Known], Order]]] = {
    "move": (("obstacle", "to"), _move),
    "push": (("velocity",), _push),
    "take": (("object",), _take),
    "policy": (
        ("policy",),
        lambda said, known: UsePolicy(policy=checks.one_of("policy", said["policy"], known.policies, InvalidOrder)),
    ),
    "noise": (("on",), lambda said, _: Noise(on=checks.flag("on", said["on"], InvalidOrder))),
    "pause": (("on",), lambda said, _: Pause(on=checks.flag("on", said["on"], InvalidOrder))),
    "restart": ((), lambda *_: Restart()),
    "restore": ((), lambda *_: Restore()),
    "slice": (("field", "height"), _slice),
}
