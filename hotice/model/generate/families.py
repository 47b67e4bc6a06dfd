"""Scene families by name, each graded from easy to hard: what `family:NAME:COUNT[:SEED]` means.

Sizes that decide the difficulty follow from the difficulty alone; where things stand is drawn from a generator seeded
with (seed, family, index). Proportions fit a G1 (1.32 m tall, shoulders 0.45 m wide) with a box of up to 0.4 m ahead of
it. Scenes of `typical` and `random` are kept only when a robot with its load gets through, those of `moving` when it
gets through in time; a draw that fails is reported and drawn again.
"""

from __future__ import annotations

import itertools
import math
import zlib
from dataclasses import dataclass

import numpy as np

from hotice import checks
from hotice.checks import Range
from hotice.errors import InvalidScene, UnknownName
from hotice.model.generate.graded import SINGLE, combo, open_floor, pillars
from hotice.model.generate.moving_set import KINDS, SPEEDS_M_S, draw_passable
from hotice.model.generate.pieces import Obstacles
from hotice.model.generate.random_clutter import random_clutter
from hotice.model.generate.traversable import check_traversable
from hotice.model.generate.typical import LOADS_M, TYPICAL
from hotice.model.scene import Scene

MAX_COUNT = 10_000
MAX_DRAWS = 200
GRADED = ("open", "pipe", "step", "gap", "pillars", "table_edge", "beam", "hanging", "combo")
"""Not checked: their geometry is fixed for good."""
CHECKED = {**TYPICAL, "random": random_clutter}
MOVING = tuple(KINDS)
"""Something moves in them, the faster the harder."""
MIXTURES = {"mixed": GRADED, "typical": tuple(TYPICAL), "all": (*GRADED, *CHECKED, "indoor"), "moving": MOVING}
"""Names that deal out other families in turn; `all`: everything that stands still."""
FAMILIES = (*GRADED, "mixed", *CHECKED, "indoor", "typical", "all", *MOVING, "moving")
LARGEST_M = (0.2, 0.2, 0.2)
_SPEEDS_M_S = (SPEEDS_M_S[0], SPEEDS_M_S[-1])
"""Of what moves, at difficulties 0 and 1."""


@dataclass(frozen=True, kw_only=True)
class Rejected:
    """A draw that was not kept: which `scene`, and why. `draw` counts from 0."""

    scene: str
    draw: int
    reason: str


@dataclass(frozen=True, kw_only=True)
class Generated:
    """Scenes of a family, and the draws that were rejected on the way to them."""

    scenes: tuple[Scene, ...]
    rejected: tuple[Rejected, ...] = ()


def generate(name: str, count: int, seed: int = 0) -> Generated:
    """`count` scenes from easy to hard, named `<family>_<index>`, or `<family>_s<seed>_<index>` for a seed above 0.

    Scene i depends on the family's name, i, `count` (which spaces the difficulty) and `seed` only.

    Raises:
        UnknownName: no such family.
        InvalidScene: `count` is not in 1..10,000 or `seed` is negative; or no draw of a scene can be traversed.
    """
    if name not in FAMILIES:
        raise UnknownName("scene family", name, FAMILIES)
    checks.whole(f"scene family {name!r}: count", count, Range(least=1, most=MAX_COUNT), InvalidScene)
    checks.whole(f"scene family {name!r}: seed", seed, checks.INT64, InvalidScene)
    if name == "indoor":
        return _indoor(count, seed)
    if name in MIXTURES:
        turn = MIXTURES[name]
        parts = [generate(f, len(range(k, count, len(turn))), seed) for k, f in enumerate(turn) if k < count]
        scenes = tuple(parts[i % len(turn)].scenes[i // len(turn)] for i in range(count))
        return Generated(scenes=scenes, rejected=tuple(r for part in parts for r in part.rejected))
    made = [_scene(name, i, float(t), seed) for i, t in enumerate(np.linspace(0.0, 1.0, count))]
    return Generated(scenes=tuple(scene for scene, _ in made), rejected=tuple(r for _, part in made for r in part))


def family_scenes(name: str, count: int, seed: int = 0) -> list[Scene]:
    """The scenes of `generate`. Raises as that."""
    return list(generate(name, count, seed).scenes)


def generate_from_text(text: str) -> Generated:
    """`generate` of `NAME:COUNT` or `NAME:COUNT:SEED`. Raises as that, and `InvalidScene` for other text."""
    name, *numbers = text.split(":")
    if name not in FAMILIES:
        raise UnknownName("scene family", name, FAMILIES)
    if not 1 <= len(numbers) <= 2 or not all(n.isascii() and n.isdigit() and len(n) < 19 for n in numbers):
        raise InvalidScene(
            f"scene family {text!r}: NAME:COUNT or NAME:COUNT:SEED is needed, such as pipe:12 or pipe:12:3"
        )
    return generate(name, *map(int, numbers))


def family_from_text(text: str) -> list[Scene]:
    """The scenes of `generate_from_text`. Raises as that."""
    return list(generate_from_text(text).scenes)


def draw_scene(
    name: str, title: str, difficulty: float, stream: tuple[int, ...], longest_m: float = math.inf
) -> tuple[Scene, list[Rejected]]:
    """One scene of a checked family called `title`, with a way through of at most `longest_m`.

    Draw n takes its numbers from `stream` and n.

    Raises:
        InvalidScene: none of 200 draws can be traversed.
    """
    rejected: list[Rejected] = []
    for draw in range(MAX_DRAWS):
        rng = np.random.default_rng([*stream, draw])
        try:
            scene = Scene(title, obstacles=tuple(CHECKED[name](difficulty, rng)))
            way = check_traversable(scene, carried_half_extents_m=LOADS_M.get(name, LARGEST_M))
            reason = way.reason or ("" if way.length_m <= longest_m else f"the way is {way.length_m:.2f} m long")
        except InvalidScene as error:
            reason = str(error)
        if not reason:
            return scene, rejected
        rejected.append(Rejected(scene=title, draw=draw, reason=reason))
    raise InvalidScene(f"scene {title!r}: none of {MAX_DRAWS} draws can be traversed; the last was {reason}")


def _scene(name: str, index: int, difficulty: float, seed: int) -> tuple[Scene, list[Rejected]]:
    title = f"{name}_s{seed}_{index:02d}" if seed else f"{name}_{index:02d}"
    stream = (seed, zlib.crc32(name.encode()), index)
    if name in CHECKED:
        return draw_scene(name, title, difficulty, stream)
    if name in MOVING:
        scene, reasons = draw_passable(name, title, float(np.interp(difficulty, (0.0, 1.0), _SPEEDS_M_S)), stream)
        return scene, [Rejected(scene=title, draw=i, reason=reason) for i, reason in enumerate(reasons)]
    rng = np.random.default_rng(stream)
    if name == "open":
        return open_floor(title, difficulty, rng), []
    return Scene(title, obstacles=tuple(_graded(name, difficulty, rng))), []


def _graded(name: str, difficulty: float, rng: np.random.Generator) -> Obstacles:
    if name == "combo":
        return combo(difficulty, rng)
    if name == "pillars":
        return pillars(difficulty, rng)
    return SINGLE[name](difficulty, float(rng.uniform(0.8, 1.3)), rng)


def _indoor(count: int, seed: int) -> Generated:
    from hotice.model.generate.indoor import indoor_scenes

    made = indoor_scenes(count, seed)
    rejected = itertools.chain.from_iterable(itertools.repeat(why, times) for why, times in made.rejected.items())
    return Generated(
        scenes=made.scenes,
        rejected=tuple(Rejected(scene="indoor", draw=i, reason=why) for i, why in enumerate(rejected)),
    )
