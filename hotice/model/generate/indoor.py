"""Furnished rooms, cropped round a start and a goal whose way passes furniture and can be walked with a load.

Scene `number` depends on that number and its difficulty only. The room's type is dealt in turn; difficulty sets how
much the room holds and, among the ways that fit it, how crowded the chosen one is. A room or way that fails is counted
with its reason and the next one is drawn from the same stream.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from hotice import checks
from hotice.checks import Range
from hotice.errors import InvalidScene
from hotice.model.generate.crop import crop, propose_ways, why_blocked
from hotice.model.generate.rooms import RECIPES, furnish
from hotice.model.geometry.lengths import LARGE_M, MEDIUM_M, SMALL_M
from hotice.model.scene import Scene

MAX_COUNT = 10_000
MAX_ROOMS, WAYS_PER_ROOM = 20, 3


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
    checks.whole("count of indoor scenes", count, Range(least=1, most=MAX_COUNT), InvalidScene)
    checks.whole("seed of indoor scenes", seed, checks.INT64, InvalidScene)
    rejected: Counter[str] = Counter()
    difficulties = np.linspace(0.0, 1.0, count)
    scenes = [_draw(float(d), seed * MAX_COUNT + i, rejected) for i, d in enumerate(difficulties)]
    return IndoorScenes(scenes=tuple(scenes), rejected=dict(rejected))


def indoor_scene(difficulty: float, number: int) -> Scene:
    """One scene; `difficulty` in 0..1. Raises `InvalidScene` for values out of range."""
    checks.number("difficulty of an indoor scene", difficulty, checks.SHARE, InvalidScene)
    checks.whole("number of an indoor scene", number, checks.INT64, InvalidScene)
    return _draw(difficulty, number, Counter())


def _draw(difficulty: float, number: int, rejected: Counter[str]) -> Scene:
    kind = list(RECIPES)[number % len(RECIPES)]
    rng = np.random.default_rng([number, len(RECIPES)])
    for _ in range(MAX_ROOMS):
        room = furnish(kind, 0.2 + 0.7 * difficulty, rng)
        ways = propose_ways(room.clearance(), rng)
        if not ways:
            rejected[f"{kind}: no free way passes furniture"] += 1
        hardest = round((0.1 + 0.8 * difficulty) * (len(ways) - 1))
        for step in range(min(WAYS_PER_ROOM, hardest + 1)):
            way = ways[hardest - step * max(hardest // WAYS_PER_ROOM, 1)]
            size = SMALL_M if way.length_m <= 2.0 + 1e-9 else (MEDIUM_M if rng.random() < 0.6 else LARGE_M)
            reason = why_blocked(room.obstacles, way)
            if not reason:
                return crop(f"indoor_{kind}_{number:03d}", room.obstacles, way.start, way.goal, size)
            rejected[f"{kind}: stopped by {_thing(reason)}"] += 1
    raise InvalidScene(f"indoor scene {number}: none of {MAX_ROOMS} rooms of type {kind!r} can be crossed")


def _thing(reason: str) -> str:
    """The kind of thing that a reason names, such as "chair" of 'dining_set1_chair2_back'."""
    name = re.search(r"'(.+?)'", reason)
    things = re.findall(r"([a-z]+(?:_[a-z]+)*)\d", name[1]) if name else []
    return things[-1].replace("_", " ") if things else "wall"
