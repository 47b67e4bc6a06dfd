"""Geodesic distance continued into obstacles and pockets, so that it is finite at every node."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from hotice.fields.grid import Grid


def extend(
    geodesic: NDArray[np.float64], gradient: NDArray[np.float64], grid: Grid
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The same arrays, (size,) [m] and (size, 3), filled in place where the distance is infinite.

    Unreachable nodes (obstacles, pockets) take the distance to the nearest reachable node plus that node's value;
    -gradient points at it. Zeros when no node is reachable.
    """
    reached = np.isfinite(geodesic)
    if reached.all():
        return geodesic, gradient
    if not reached.any():
        geodesic[:], gradient[:] = 0.0, 0.0
        return geodesic, gradient
    lost = np.flatnonzero(~reached)
    nearest = _nearest(reached.reshape(grid.shape))[lost]
    away = grid.points(lost) - grid.points(nearest)
    gap = np.linalg.norm(away, axis=1)
    geodesic[lost] = geodesic[nearest] + gap
    gradient[lost] = away / gap[:, None]
    return geodesic, gradient


def _nearest(reached: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Flat index of the nearest reached node of every node that is not, (size,); both kinds are there.

    It lies in the box about the nodes that are not, one node wider: clamped to that box a node comes nearer to all of
    it, and where it moved it lands on the rim, which is reached.
    """
    lost = np.nonzero(~reached)
    box = tuple(slice(max(i.min() - 1, 0), i.max() + 2) for i in lost)
    found = ndimage.distance_transform_edt(~reached[box], return_distances=False, return_indices=True)
    nearest = np.zeros(reached.shape, dtype=np.int64)
    first = [b.start for b in box]
    nearest[box] = np.ravel_multi_index(
        tuple(f + i for f, i in zip(np.asarray(found), first, strict=True)), reached.shape
    )
    return nearest.reshape(-1)
