"""What a page shows of fields: planned ways, and a horizontal slice of directions."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hotice.fields.descent import descend
from hotice.fields.hod_pf import GuidanceField
from hotice.model import g1
from hotice.model.scene import Scene
from hotice.policy import Percept

Array = NDArray[np.float64]
STEP_M, LONGEST_M = 0.05, 5.0
"""Between points of a way, and its length at most [m]."""
SPACING_M, MOST_ARROWS = 0.1, 900
"""Between arrows of a slice [m], and how many there are at most: a large scene has them further apart."""
INSIDE = 999
"""In place of an angle: inside an obstacle of the field."""
_HEAD = g1.SGF_KEYPOINTS.index("head")


def ways(sgf: GuidanceField, ogf: GuidanceField, percept: Percept) -> list[dict[str, Any]]:
    """Ways to the goal that fields plan for single points: head and pelvis by the SGF, the object's centre by the OGF.

    Each as its field and points x, y, z, flat, in W [m] to the centimetre.
    """
    robot = descend(sgf, np.stack([percept.p_WK[_HEAD], percept.p_WP]), step_m=STEP_M, length_m=LONGEST_M)
    load = descend(ogf, percept.p_WO[None], step_m=STEP_M, length_m=LONGEST_M)
    shown = [("sgf", robot[:, 0]), ("sgf", robot[:, 1]), ("ogf", load[:, 0])]
    return [{"field": field, "points": np.round(points, 2).ravel().tolist()} for field, points in shown]


def slice_of(guide: GuidanceField, scene: Scene, height_m: float) -> dict[str, Any]:
    """Where a field leads, horizontally, at points of a height: x, y of the first, spacing [m], counts, angles [deg].

    Angles are whole and row by row along x; `INSIDE` where there is none.
    """
    low, high = (np.array(corner[:2]) for corner in scene.bounds_m)
    spacing = max(SPACING_M, math.sqrt(float(np.prod(high - low)) / MOST_ARROWS))
    count = np.maximum(((high - low) / spacing).astype(int), 1)
    first = 0.5 * (low + high - spacing * (count - 1))
    x, y = (first[i] + spacing * np.arange(count[i]) for i in range(2))
    points = np.stack([*np.meshgrid(x, y), np.full((count[1], count[0]), height_m)], axis=-1)
    force, distance, _ = guide.query(points)
    angle = np.rint(np.degrees(np.arctan2(force[..., 1], force[..., 0]))).astype(int)
    return {
        "first": np.round(first, 3).tolist(),
        "height": height_m,
        "spacing": round(spacing, 4),
        "columns": int(count[0]),
        "angles": np.where(distance > 0.0, angle, INSIDE).ravel().tolist(),
    }
