"""AprilTags on a box: which tag's corners are where, so that the tags of two faces are solved together.

Family 36h11. On the top, which the head camera sees of a carried box, and on the near face, which it sees before the
pick-up: 2×2 tags of 50 mm each, so that no single tag's flip decides.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hotice import checks
from hotice.checks import Range
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
TAGS = 8
"""Of a box: the top's four, then the near face's."""
FIRST_ID = Range(least=0, most=579, note="the family has the ids 0 to 586")


@dataclass(frozen=True, kw_only=True, eq=False)
class TagFace:
    """One face of a box, with a square sheet of tags on it, as one looks at it from outside."""

    name: str
    """"top" or "near"."""
    ids: tuple[int, ...]
    middle_O: Array
    """(3,) of the sheet [m]."""
    right_O: Array
    """(3,) unit, along the sheet."""
    up_O: Array
    """(3,) unit, along the sheet."""
    above_m: float
    """From the sheet's upper edge to the face's upper edge."""
    beside_m: float
    """From the sheet's left and right edge to the face's."""
    edges: tuple[str, str]
    """What the upper and the lower edge of the sheet point to."""

    @property
    def normal_O(self) -> Array:
        """(3,) out of the box."""
        return np.cross(self.right_O, self.up_O)

    def corners_O(self) -> Array:
        """Corners of its tags, in two rows, left to right, (4, 4, 3) [m]."""
        signs = ((-1.0, 1.0), (1.0, 1.0), (1.0, -1.0), (-1.0, -1.0))
        middles = [(0.5 * PITCH_M * x, 0.5 * PITCH_M * y) for y in (1.0, -1.0) for x in (-1.0, 1.0)]
        flat = np.array([[(x + 0.5 * TAG_M * i, y + 0.5 * TAG_M * j) for i, j in signs] for x, y in middles])
        return self.middle_O + flat @ np.stack([self.right_O, self.up_O])


@dataclass(frozen=True, kw_only=True, eq=False)
class TagBundle:
    """Tags of one box by id, and their corners in the box's frame O."""

    faces: tuple[TagFace, ...]
    ids: tuple[int, ...]
    corners_O: Array
    """(T, 4, 3) [m]: top left, top right, bottom right, bottom left of each tag as one looks at it, as OpenCV's
    detector gives them."""
    normals_O: Array
    """(T, 3) out of the box."""


def box_ids(first_id: int = 0) -> tuple[int, ...]:
    """Ids of a box's tags; boxes that may be seen together need each their own. Raises `InvalidConfig`."""
    first = checks.whole("first_id", first_id, FIRST_ID)
    return tuple(range(first, first + TAGS))


def box_bundle(box: Box, *, first_id: int = 0) -> TagBundle:
    """The eight tags of a box, seen by a robot behind it. Raises `InvalidConfig`: ids, a face smaller than a sheet."""
    ids = box_ids(first_id)
    half = box.half_extents_m
    if (2.0 * half < SHEET_M).any():
        size, least = " × ".join(f"{v:g}" for v in box.size_m), "xyz"[int(np.argmin(half))]
        raise InvalidConfig(
            f"box of {size} m: its side {least} is too small, a sheet of tags needs at least {SHEET_M:g} m each way"
        )
    right, ahead, up = np.array([0.0, -1.0, 0.0]), np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])
    x = min(TOP_AHEAD_M, half[0] - 0.5 * SHEET_M)
    top = TagFace(
        name="top",
        ids=ids[:4],
        middle_O=np.array([x, 0.0, half[2]]),
        right_O=right,
        up_O=ahead,
        above_m=half[0] - x - 0.5 * SHEET_M,
        beside_m=half[1] - 0.5 * SHEET_M,
        edges=("away from the robot", "toward the robot"),
    )
    near = TagFace(
        name="near",
        ids=ids[4:],
        middle_O=np.array([-half[0], 0.0, 0.0]),
        right_O=right,
        up_O=up,
        above_m=half[2] - 0.5 * SHEET_M,
        beside_m=half[1] - 0.5 * SHEET_M,
        edges=("up", "down"),
    )
    faces = (top, near)
    return TagBundle(
        faces=faces,
        ids=ids,
        corners_O=np.concatenate([face.corners_O() for face in faces]),
        normals_O=np.concatenate([np.repeat([face.normal_O], len(face.ids), axis=0) for face in faces]),
    )
