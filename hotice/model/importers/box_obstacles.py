"""Boxes whose union is a set of voxels, as obstacles."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from hotice.model.geometry.extents import category_by_height
from hotice.model.geometry.shapes import BoxShape
from hotice.model.importers.voxels import column_extent
from hotice.model.scene import Obstacle


def box_obstacles(
    solid: NDArray[np.bool_],
    boxes: NDArray[np.int64],
    low_W: NDArray[Any],
    high_W: NDArray[Any],
    voxel_m: float,
    name: str,
) -> list[Obstacle]:
    """One obstacle for each box of voxels.

    Args:
        solid: (nx, ny, nz) voxels. boxes: (n, 6) first and, exclusive, last index along each axis (`cover_by_boxes`).
        low_W, high_W: (3,) corners of the voxels' bounds [m]; boxes end at `high_W`. voxel_m: edge [m].
        name: with a place for the number, from 1 on: `box_{:04d}`.
    """
    found = []
    for n, box in enumerate(boxes):
        first, last = low_W + voxel_m * box[:3], np.minimum(low_W + voxel_m * box[3:], high_W)
        layers = column_extent(solid, box)
        kind = category_by_height(*(round(float(low_W[2]) + voxel_m * layer, 9) for layer in layers))
        size, centre = np.round(last - first, 6).tolist(), np.round(0.5 * (first + last), 6).tolist()
        found.append(Obstacle(name.format(n + 1), kind, BoxShape(tuple(size)), tuple(centre)))
    return found
