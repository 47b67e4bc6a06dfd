"""Detector: from a grey picture to ids and corners of a bundle's tags; what does not belong there is counted."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hotice.deploy.tags.markers import dictionary, opencv
from hotice.errors import InvalidState

Array = NDArray[np.float64]
WINDOW_CELLS, MOST_WINDOW_PX = 0.8, 8
"""Half of the window around a corner in which its edges are looked at: just less than the border, one cell, is wide."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Detection:
    """Tags of a bundle in one picture."""

    ids: NDArray[np.int64]
    """(T,), each once."""
    corners_px: Array
    """(T, 4, 2), order as `TagBundle.corners_O`; a whole number is the middle of a pixel."""
    foreign: int
    """Tags of the family with other ids."""
    doubled: int
    """Tags whose id is there more than once: another box has the same sheets, and none of the picture's is believed."""


class TagDetector:
    """Finds tags of some ids, of the family 36h11 and printed by `hotice tags`; a mirrored one is none of them."""

    def __init__(self, ids: Collection[int]) -> None:
        """Raises `MissingExtra` without OpenCV."""
        aruco = opencv().aruco
        parameters = aruco.DetectorParameters()
        parameters.cornerRefinementMethod = aruco.CORNER_REFINE_SUBPIX
        parameters.relativeCornerRefinmentWinSize = WINDOW_CELLS
        parameters.cornerRefinementWinSize = MOST_WINDOW_PX
        self._ids = frozenset(ids)
        self._detector = aruco.ArucoDetector(dictionary(), parameters)

    def detect(self, picture: NDArray[np.uint8]) -> Detection:
        """Tags of a grey picture (height, width). Raises `InvalidState` for anything else."""
        if picture.ndim != 2 or picture.dtype != np.uint8 or not picture.size:
            raise InvalidState(
                f"picture has shape {picture.shape} and type {picture.dtype}: grey is needed, (height, width) of uint8"
            )
        corners, ids, _ = self._detector.detectMarkers(picture)
        found = [] if ids is None else [int(tag) for tag in np.ravel(ids)]
        ours = [tag for tag in found if tag in self._ids]
        doubled = sum(count for count in Counter(ours).values() if count > 1)
        # whose the single ones are cannot be told either
        kept = [] if doubled else sorted((tag, k) for k, tag in enumerate(found) if tag in self._ids)
        return Detection(
            ids=np.array([tag for tag, _ in kept], dtype=np.int64),
            corners_px=np.array([corners[k][0] for _, k in kept], dtype=float).reshape(-1, 4, 2),
            foreign=len(found) - len(ours),
            doubled=doubled,
        )
