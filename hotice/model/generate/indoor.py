"""Furnished rooms, cropped round a start and a goal whose way passes furniture and can be walked with a load.

Scene `number` depends on that number and its difficulty only. The room's type is dealt in turn; difficulty sets how much
the room holds and, among the ways that fit it, how crowded the chosen one is. A room or way that fails is counted with
its reason and the next one is drawn from the same stream.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from hotice.errors import InvalidScene
from hotice.model.generate.crop import LARGE_M, MEDIUM_M, SMALL_M, Way, crop, propose_ways
from hotice.model.generate.rooms import RECIPES, Room, furnish
from hotice.model.generate.traversable import check_traversable
from hotice.model.scene import Scene

MAX_COUNT = 10_000
MAX_ROOMS, WAYS_PER_ROOM = 20, 3
CORRIDOR_M = 2.6
"""The way through is looked for at most half this far off the straight one: a detour beyond takes too long to carry."""


@dataclass(frozen=True, kw_only=True)
class IndoorScenes:
    """Scenes, and how many rooms and ways were `rejected` on the way to them, by reason."""

    scenes: tuple[Scene, ...]
    rejected: Mapping[str, int]


def indoor_scenes(count: int, seed: int = 0) -> IndoorScenes:
    """`count` scenes from easy to hard, named `indoor_<room>_<number>`; scene i has number `seed` * 10,000 + i.

    Raises:
        InvalidScene: `count` is not in 1..10,000 or `seed` is negative.
    """
    if not 1 <= count <= MAX_COUNT or seed < 0:
        raise InvalidScene(
            f"{count} indoor scenes of seed {seed}: 1 to {MAX_COUNT:,} of a seed of at least 0 are allowed"
        )
    rejected: Counter[str] = Counter()
    difficulties = np.linspace(0.0, 1.0, count)
    scenes = [_draw(float(d), seed * MAX_COUNT + i, rejected) for i, d in enumerate(difficulties)]
    return IndoorScenes(scenes=tuple(scenes), rejected=dict(rejected))


def indoor_scene(difficulty: float, number: int) -> Scene:
    """One scene; `difficulty` in 0..1. Raises `InvalidScene` for values out of range."""
    if not 0.0 <= difficulty <= 1.0 or number < 0:
        raise InvalidScene(f"indoor scene {number!r} of difficulty {difficulty!r}: at least 0, and 0 to 1, are allowed")
    return _draw(difficulty, number, Counter())


def _draw(difficulty: float, number: int, rejected: Counter[str]) -> Scene:
    kind = list(RECIPES)[number % len(RECIPES)]
    rng = np.random.default_rng([number, len(RECIPES)])
    for _ in range(MAX_ROOMS):
        room = furnish(kind, 0.2 + 0.7 * difficulty, rng)
        ways = propose_ways(room.clearance(), rng)
        if not ways:
            rejected["no free way passes furniture"] += 1
        hardest = round((0.1 + 0.8 * difficulty) * (len(ways) - 1))
        for step in range(min(WAYS_PER_ROOM, hardest + 1)):
            way = ways[hardest - step * max(hardest // WAYS_PER_ROOM, 1)]
            size = SMALL_M if way.length_m <= 2.0 + 1e-9 else (MEDIUM_M if rng.random() < 0.6 else LARGE_M)
            reason = _blocked(room, way)
            if not reason:
                return crop(f"indoor_{kind}_{number:03d}", room.obstacles, way.start, way.goal, size)
            rejected[reason] += 1
    raise InvalidScene(f"indoor scene {number}: none of {MAX_ROOMS} rooms of type {kind!r} can be crossed")


def _blocked(room: Room, way: Way) -> str:
    """Why a load cannot be carried along the way, with the kind of thing that stops it; empty when it can."""
    try:
        size = (way.length_m + 1.0, CORRIDOR_M, SMALL_M[2])
        traversal = check_traversable(crop("way", room.obstacles, way.start, way.goal, size))
    except InvalidScene:
        return "start or goal is not free"
    if traversal.ok:
        return ""
    name = re.search(r"'(.+?)'", traversal.reason)
    things = re.findall(r"([a-z]+(?:_[a-z]+)*)\d", name[1]) if name else []
    return f"stopped by {things[-1].replace('_', ' ')}" if things else "not traversable"
