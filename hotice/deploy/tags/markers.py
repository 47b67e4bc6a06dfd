"""Patterns of the tags, from OpenCV's own dictionary: what is printed is what is looked for.

OpenCV's pattern of a tag is AprilTag's turned by 180° in its plane: sheets of other programs do not fit the bundle.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hotice.errors import MissingExtra, UnknownName

CELLS = 8
"""Cells of a side: six of the pattern and a black border of one."""


def opencv() -> Any:
    """OpenCV's module, imported when it is first asked for. Raises `MissingExtra`."""
    try:
        import cv2
    except ImportError:
        raise MissingExtra("finding and printing tags", "OpenCV", "deploy") from None
    return cv2


@cache
def dictionary() -> Any:
    """OpenCV's dictionary of the family 36h11. Raises `MissingExtra`."""
    aruco = opencv().aruco
    return aruco.getPredefinedDictionary(aruco.DICT_APRILTAG_36h11)


@cache
def black_cells(tag: int) -> NDArray[np.bool_]:
    """Which cells of a tag are black, (8, 8) by row from the top. Raises `UnknownName` or `MissingExtra`."""
    count = len(dictionary().bytesList)
    if not 0 <= tag < count:
        raise UnknownName("tag", tag, [f"0 to {count - 1}"])
    cells = opencv().aruco.generateImageMarker(dictionary(), tag, CELLS) == 0
    cells.setflags(write=False)
    return cells
