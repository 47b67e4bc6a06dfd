"""AprilTags on a box: which tag's corners are where, so that the tags of two faces are solved together.

Family 36h11. On the top, which the head camera sees of a carried box, and on the near face, which it sees before the
pick-up: 2×2 tags of 50 mm each, so that no single tag's flip decides.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hotice.errors import InvalidConfig
from hotice.model.objects import Box

Array = NDArray[np.float64]
TAG_M = 0.05
"""Black square of a tag, whose corners are seen."""
PITCH_M = 0.07
"""From tag to tag."""
SHEET_M = 0.14
"""A side of the four with their white margins."""
TOP_AHEAD_M = 0.035
"""The top's four are so far ahead of the middle, where the camera sees them on boxes of every size."""
TOP_IDS, NEAR_IDS = (0, 1, 2, 3), (4, 5, 6, 7)


@dataclass(frozen=True, kw_only=True, eq=False)
class TagBundle:
    """Tags of one box by id, and their corners in the box's frame O."""

    ids: tuple[int, ...]
    corners_O: Array
    """(T, 4, 3) [m]: top left, top right, bottom right, bottom left of each tag as one looks at it, as OpenCV's
    detector gives them."""
    normals_O: Array
    """(T, 3) out of the box."""


def box_bundle(box: Box) -> TagBundle:
    """The eight tags of a box, seen by a robot behind it. Raises `InvalidConfig`: a face smaller than a sheet."""
    half = box.half_extents_m
    if (2.0 * half < SHEET_M).any():
        raise InvalidConfig(f"box of {' × '.join(f'{v:g}' for v in box.size_m)} m: tags need {SHEET_M:g} m each way")
    right, ahead, up = np.array([0.0, -1.0, 0.0]), np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])
    top = np.array([min(TOP_AHEAD_M, half[0] - 0.5 * SHEET_M), 0.0, half[2]])
    near = np.array([-half[0], 0.0, 0.0])
    corners = np.concatenate([_sheet(top, right, ahead), _sheet(near, right, up)])
    return TagBundle(ids=TOP_IDS + NEAR_IDS, corners_O=corners, normals_O=np.repeat([up, -ahead], 4, axis=0))


def _sheet(middle: Array, right: Array, up: Array) -> Array:
    """Corners of four tags in two rows, left to right, (4, 4, 3)."""
    signs = ((-1.0, 1.0), (1.0, 1.0), (1.0, -1.0), (-1.0, -1.0))
    middles = [middle + 0.5 * PITCH_M * (x * right + y * up) for y in (1.0, -1.0) for x in (-1.0, 1.0)]
    return np.array([[m + 0.5 * TAG_M * (x * right + y * up) for x, y in signs] for m in middles])
