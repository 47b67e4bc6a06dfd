"""Geodesic distance continued into obstacles and pockets, so that it is finite at every node."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from hotice.fields.grid import Grid


def extend(
    geodesic: NDArray[np.float64], gradient: NDArray[np.float64], grid: Grid
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Finite distance (size,) [m] and its gradient (size, 3) at every node.

    Unreachable nodes (obstacles, pockets) take the distance to the nearest reachable node plus that node's value;
    -gradient points at it. Zeros when no node is reachable.
    """
    reached = np.isfinite(geodesic)
    if not reached.any():
        return np.zeros(grid.size), np.zeros((grid.size, 3))
    if reached.all():
        return geodesic, gradient
    nearest = ndimage.distance_transform_edt(
        ~reached.reshape(grid.shape), sampling=grid.resolution_m, return_distances=False, return_indices=True
    )
    nearest = np.ravel_multi_index(tuple(np.asarray(nearest).reshape(3, -1)), grid.shape)
    lost = np.flatnonzero(~reached)
    away = grid.points(lost) - grid.points(nearest[lost])
    gap = np.linalg.norm(away, axis=1)
    value, slope = geodesic.copy(), gradient.copy()
    value[lost] = geodesic[nearest[lost]] + gap
    slope[lost] = away / gap[:, None]
    return value, slope
