"""Composition of the benchmark sets `bench20`, `train75` and `unseen50`.

The shipped files are the sets, fixed for good; this module says how they were drawn (by `tools/make_sets.py`) and draws
them again. A scene's numbers come from (set, family, its place in the set), so no two sets share a draw. Every scene
can be traversed with a 40 cm box, on a way short enough for 5 s.
"""

from __future__ import annotations

import itertools
import zlib
from dataclasses import dataclass

import numpy as np

from hotice.errors import UnknownName
from hotice.model.generate.families import Rejected, draw_scene
from hotice.model.generate.indoor import indoor_scene
from hotice.model.generate.traversable import check_traversable
from hotice.model.scene import Scene

LONGEST_M = 2.4
INDOOR_LONGEST_M = 2.8
INDOOR_NUMBERS = {"train75": 7_000_000, "unseen50": 8_000_000}
"""Numbers of indoor scenes, far from those of `family:indoor`."""


@dataclass(frozen=True, kw_only=True)
class Entry:
    """One scene of a set: its family and difficulty."""

    family: str
    difficulty: float


def _graded(easy: float, hard: float, **counts: int) -> tuple[Entry, ...]:
    """`counts` scenes of each family, their difficulties evenly spread."""
    return tuple(
        Entry(family=family, difficulty=float(t))
        for family, count in counts.items()
        for t in np.linspace(easy, hard, count)
    )


SETS: dict[str, tuple[Entry, ...]] = {
    "bench20": (
        *_graded(0.35, 0.8, side_gap=2, table=2),
        *_graded(0.5, 0.5, slalom=1),
        *_graded(0.25, 0.7, beam_across=3),
        *_graded(0.4, 0.8, lamps=2),
        *_graded(0.2, 0.55, one_pipe=2),
        *_graded(0.4, 0.4, one_step=1),
        *_graded(0.2, 0.2, two_pipes=1, two_steps=1),
        *_graded(0.2, 0.8, combination=3),
        *_graded(0.5, 0.5, gauntlet=1, random=1),
    ),
    "train75": _graded(
        0.0,
        0.95,
        one_pipe=6,
        one_step=6,
        beam_across=8,
        side_gap=9,
        slalom=7,
        table=8,
        lamps=6,
        combination=6,
        random=4,
        indoor=15,
    ),
    "unseen50": _graded(
        0.1,
        0.85,
        one_pipe=2,
        one_step=2,
        beam_across=3,
        side_gap=3,
        slalom=2,
        table=3,
        lamps=2,
        combination=3,
        random=6,
        two_pipes=2,
        two_steps=2,
        s_bend=5,
        gauntlet=5,
        indoor=10,
    ),
}
"""Scenes of each set in order. `unseen50` holds kinds of scene that `train75` lacks."""


def draw_entry(name: str, index: int) -> tuple[Scene, list[Rejected]]:
    """Scene `index` of the set `name`, called `<set>/<number>_<family>`, and the draws rejected on the way.

    Raises:
        UnknownName: no such set.
        InvalidScene: no draw can be traversed.
    """
    if name not in SETS:
        raise UnknownName("scene set", name, SETS)
    entry = SETS[name][index]
    title = f"{name}/{index + 1:02d}_{entry.family}"
    if entry.family != "indoor":
        stream = (zlib.crc32(name.encode()), zlib.crc32(entry.family.encode()), index)
        return draw_scene(entry.family, title, entry.difficulty, stream, LONGEST_M)
    rejected: list[Rejected] = []
    for draw in itertools.count():
        scene = indoor_scene(entry.difficulty, INDOOR_NUMBERS[name] + 1000 * index + draw)
        way = check_traversable(scene)
        if way.ok and way.length_m <= INDOOR_LONGEST_M:
            break
        rejected.append(Rejected(scene=title, draw=draw, reason=way.reason or f"the way is {way.length_m:.2f} m long"))
    return scene.renamed(title), rejected
