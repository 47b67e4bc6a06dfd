"""The room a G1 takes up while it carries: boxes in its heading frame, for each of a few postures.

The boxes hold the collision geometry of `g1.xml` in the carry states of `solve_carry` (boxes of 20 to 40 cm, pelvis
0.79 to 0.44 m high, leaning up to 0.3 rad below 0.56 m) to about 2 cm. Frame: x ahead, y left, z up, origin on the
floor below the pelvis. All numbers are ours:

| Part  | x [m]                  | y [m]              | z [m], h = pelvis height, c = height of the load's centre     |
|-------|------------------------|--------------------|---------------------------------------------------------------|
| feet  | -0.06 .. 0.16          | ± 0.15             | 0 .. 0.15: what a foot needs to stand                         |
| shins | -0.06 .. 0.20          | ± 0.17             | 0.175 .. 0.35: never free of the legs, so 15 cm is the step   |
| hips  | -0.07 .. 0.17 + 0.75 d | ± 0.17             | 0.30 - 0.3 d .. h - 0.05; crouching by d brings the knees on  |
| trunk | -0.08 .. 0.09          | ± 0.11             | h - 0.16 .. h + 0.53, head included (1.32 m upright)          |
| arms  | -0.12 .. 0.12          | ± (0.15 + 0.45 w)  | h + 0.06 .. h + 0.34; w is half the load's width              |
| hands | 0 .. load's centre + 0.08 | ± (w + 0.065)   | c - 0.06 .. c + 0.06                                          |
| load  | 0.094 .. + its length  | ± w                | c ± half its height, c = h + 0.10, raised or lowered by 15 cm |

The knees end at x = 0.36 m. Leaning moves the front of the trunk by 10 cm, of the arms by 5 cm and the load by 6 cm.
Neglected: the feet of a crouching robot stand 4 cm further ahead, and its shins slope ahead below 20 cm.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hotice.model.g1 import STANDING_HEIGHT_M

STEP_HEIGHT_M = 0.15
"""Highest obstacle that is stepped over."""
DROP_STEP_M, LOAD_STEPS = 0.05, 3
"""Postures differ by this much pelvis height; the load is raised or lowered by this many steps."""
DROPS, UPRIGHT_DROPS = 8, 5
"""Pelvis heights: 0, 5, ... 35 cm below upright; in the first 20 cm the trunk stays upright."""
CORE = np.array([(0.346, 0.045), *((z, 0.08) for z in (0.72, 0.76, 0.80, 0.84, 0.88))])
"""Height and radius [m] of balls on the axis that lie inside the envelope of every posture, whatever the heading."""
COVER_RADIUS_M = 0.05
FEET, SHINS = 0, 1
"""Blocks of an `Envelope` that no posture changes."""

Vec3 = tuple[float, float, float]
Box3 = tuple[Vec3, Vec3]
"""Lowest and highest corner in the heading frame [m]."""
FEET_BOX: Box3 = ((-0.06, -0.15, 0.0), (0.16, 0.15, STEP_HEIGHT_M))
SHINS_BOX: Box3 = ((-0.06, -0.17, 0.175), (0.20, 0.17, 0.35))


@dataclass(frozen=True, kw_only=True)
class EnvelopePosture:
    """Pelvis lowered by `drop` steps, load moved by `lift` steps relative to the chest."""

    drop: int
    lift: int

    @property
    def name(self) -> str:
        """`upright` or `crouched_<cm>`, with `_raised` or `_lowered` for the load."""
        body = "upright" if self.drop == 0 else f"crouched_{round(100 * DROP_STEP_M * self.drop)}"
        return body + {0: "", LOAD_STEPS: "_raised", -LOAD_STEPS: "_lowered"}[self.lift]

    @property
    def effort(self) -> float:
        """Cost of a metre in this posture, 1 for upright."""
        return 1.0 + 0.03 * self.drop + 0.05 * (self.lift != 0)

    def is_next_to(self, other: EnvelopePosture) -> bool:
        """Whether one changes into the other directly: one step of the pelvis, or one move of the load."""
        return abs(self.drop - other.drop) + abs(self.lift - other.lift) // LOAD_STEPS == 1


_ALL = itertools.product(range(DROPS), (0, LOAD_STEPS, -LOAD_STEPS))
_POSSIBLE = {0: DROPS, LOAD_STEPS: UPRIGHT_DROPS, -LOAD_STEPS: 2}  # a lowered load would meet bent thighs
POSTURES = tuple(sorted((EnvelopePosture(drop=d, lift=m) for d, m in _ALL if d < _POSSIBLE[m]), key=lambda p: p.effort))
"""By rising effort."""
LOAD_LEVELS = tuple(range(1 - DROPS, LOAD_STEPS + 1))
"""Heights of the load in steps above its upright, neutral one."""


@dataclass(frozen=True, kw_only=True)
class Envelope:
    """Sphere covers of the parts, grouped by what they depend on.

    Blocks: feet, shins, then one `body` (hips, trunk, arms) a drop, then one `reach` (hands, load) a load level.

    Attributes:
        centre: (S, 3) in the heading frame [m]; spheres of block b are rows `first[b]:first[b + 1]`. radius: (S,) [m].
        ball: (B, 4) centre and radius of a ball round each block [m].
        posture_blocks: (P, 2) body and reach block of each of `POSTURES`.
    """

    centre: NDArray[np.float64]
    radius: NDArray[np.float64]
    first: NDArray[np.int64]
    ball: NDArray[np.float64]
    posture_blocks: NDArray[np.int64]

    @classmethod
    def of(cls, carried_half_extents_m: Vec3) -> Envelope:
        """The envelope of a robot with a load of these half extents."""
        blocks = [[FEET_BOX], [SHINS_BOX], *(_body(drop, carried_half_extents_m) for drop in range(DROPS))]
        blocks += [_reach(level, carried_half_extents_m) for level in LOAD_LEVELS]
        covers = [tuple(map(np.concatenate, zip(*map(_cover, boxes), strict=True))) for boxes in blocks]
        middle = np.array([0.5 * (c.min(axis=0) + c.max(axis=0)) for c, _ in covers])
        reach = [(np.linalg.norm(c - m, axis=1) + r).max() for (c, r), m in zip(covers, middle, strict=True)]
        first_reach = 2 + DROPS - LOAD_LEVELS[0]
        return cls(
            centre=np.concatenate([c for c, _ in covers]),
            radius=np.concatenate([r for _, r in covers]),
            first=np.cumsum([0, *(len(r) for _, r in covers)]),
            ball=np.column_stack([middle, reach]),
            posture_blocks=np.array([(2 + p.drop, first_reach + p.lift - p.drop) for p in POSTURES]),
        )


def posture_boxes(posture: EnvelopePosture, carried_half_extents_m: Vec3) -> list[Box3]:
    """Feet, shins, hips, trunk, arms, hands and load."""
    body = _body(posture.drop, carried_half_extents_m)
    return [FEET_BOX, SHINS_BOX, *body, *_reach(posture.lift - posture.drop, carried_half_extents_m)]


def _body(drop: int, carried: Vec3) -> list[Box3]:
    depth, leans = DROP_STEP_M * drop, drop >= UPRIGHT_DROPS
    pelvis, arms = STANDING_HEIGHT_M - depth, 0.15 + 0.45 * carried[1]
    return [
        ((-0.07, -0.17, 0.30 - 0.3 * depth), (min(0.17 + 0.75 * depth, 0.36), 0.17, pelvis - 0.05)),
        ((-0.08, -0.11, pelvis - 0.16), (0.19 if leans else 0.09, 0.11, pelvis + 0.53)),
        ((-0.12, -arms, pelvis + 0.06), (0.17 if leans else 0.12, arms, pelvis + 0.34)),
    ]


def _reach(level: int, carried: Vec3) -> list[Box3]:
    """Hands and load; only a leaning robot without a raised load reaches the lowest levels."""
    length, width, height = carried
    centre = STANDING_HEIGHT_M + 0.10 + DROP_STEP_M * level
    near, hands = 0.154 if -level >= UPRIGHT_DROPS else 0.094, width + 0.065
    return [
        ((0.0, -hands, centre - 0.06), (near + length + 0.08, hands, centre + 0.06)),
        ((near, -width, centre - height), (near + 2 * length, width, centre + height)),
    ]


def _cover(box: Box3) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Spheres along the inside of a box's surface, (S, 3) and (S,): only needles pass between them."""
    low, high = np.array(box)
    radius = min(COVER_RADIUS_M, 0.5 * float((high - low).min()))
    spacing = 1.4 * radius
    counts = np.ceil((high - low - 2 * radius) / spacing - 1e-9).astype(int) + 1
    axes = [np.linspace(a + radius, b - radius, n) for a, b, n in zip(low, high, counts, strict=True)]
    index = np.array(list(itertools.product(*map(range, counts))))
    outside = ((index == 0) | (index == counts - 1)).any(axis=1)
    centre = np.stack([axis[i] for axis, i in zip(axes, index[outside].T, strict=True)], axis=1)
    return centre, np.full(len(centre), radius)
