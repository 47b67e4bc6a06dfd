"""What of a scene has changed, as far as searches of paths can notice it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from hotice.model.geometry.extents import extent
from hotice.model.scene import Obstacle

_PAD_CELLS, _PAD_PER_M = 0.3, 2.0
"""Beyond an obstacle inflated by the margin a search notices it within these cells, for normals beside a bend, and this
times h^2, for depths and lifts of `segments.py` and `bends.py`."""


def changed_obstacles(before: Sequence[Obstacle], now: Sequence[Obstacle]) -> list[Obstacle] | None:
    """Obstacles of either scene that the other has not; None where those of both stand in another order.

    Which of two obstacles is asked first may decide what a search finds, so that their order counts.
    """
    here, there = set(now), set(before)
    if [o for o in before if o in here] != [o for o in now if o in there]:
        return None
    return [o for o in before if o not in here] + [o for o in now if o not in there]


def changed_boxes(changed: Sequence[Obstacle], margin_m: float, resolution_m: float) -> NDArray[np.float64]:
    """Boxes (M, 6), least and largest coordinates in W [m], outside of which no search notices these obstacles."""
    pad = margin_m + _PAD_CELLS * resolution_m + _PAD_PER_M * resolution_m**2
    boxes = np.empty((len(changed), 6))
    for i, obstacle in enumerate(changed):
        low, high = extent(obstacle)
        boxes[i] = *(low - pad), *(high + pad)
    return boxes
