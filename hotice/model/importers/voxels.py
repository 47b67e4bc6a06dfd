"""Occupied voxels of a point set, cleaned, and the boxes that cover them.

Boxes, not a voxel surface mesh: a scene's distance to a box is a few operations and exact, the simulator collides with
boxes natively (a mesh costs one prism per triangle, of which it allows 4,000), and a box in a file can be read and
edited. Faces err outward: 2.6 to 3.2 cm on average at 4 cm voxels, for noise of 3 to 20 mm (`python -m
benchmarks.importers`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import cast

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from hotice.compiled import compiled

Points = NDArray[np.float64]
FRINGE_SHARE = 0.4
"""A voxel with fewer points than this share of a neighbour's holds the fringe of that neighbour's surface."""
_NEIGHBOURS = ndimage.generate_binary_structure(3, 1)
_TOUCHING = ndimage.generate_binary_structure(3, 3)


@dataclass(frozen=True, kw_only=True)
class Voxels:
    """Cubes of edge `size_m`; voxel (0, 0, 0) begins at `low` (3,) in W [m]; `count` (nx, ny, nz) points in each."""

    low: NDArray[np.float64]
    size_m: float
    count: NDArray[np.int64]

    @classmethod
    def of(cls, p_W: Points, low: Points, high: Points, size_m: float) -> Voxels:
        """Counts the points (n, 3) within low .. high; the last layers may reach beyond `high`."""
        shape = np.ceil((np.asarray(high) - low) / size_m - 1e-6).astype(int)
        voxels = cls(low=np.asarray(low, dtype=np.float64), size_m=size_m, count=np.zeros(shape, dtype=np.int64))
        inside = p_W[((p_W >= low) & (p_W < high)).all(axis=1)]
        flat = np.ravel_multi_index(tuple(voxels.index(inside).T), tuple(shape))
        return replace(voxels, count=np.bincount(flat, minlength=voxels.count.size).reshape(shape))

    def index(self, p_W: Points) -> NDArray[np.int64]:
        """Voxel of each point that lies within, (n, 3) -> (n, 3)."""
        cell = ((p_W - self.low) / self.size_m).astype(np.int64)
        return np.minimum(cell, np.array(self.count.shape) - 1)

    def holding(self, p_W: Points, mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Whether points, (n, 3) within the grid, lie in voxels of `mask`, (n,)."""
        return mask[tuple(self.index(p_W).T)]


def occupied(
    voxels: Voxels,
    min_points: int,
    min_voxels: int,
    full: NDArray[np.bool_] | None = None,
    stood_in: Sequence[NDArray[np.bool_]] = (),
) -> NDArray[np.bool_]:
    """Voxels that stand for something solid, (nx, ny, nz); with `min_points` 0 the density decides, 1 to 3.

    Dropped are voxels of fewer than `min_points` points or in the fringe of a denser neighbour, and groups (touching by
    a corner at least) of fewer than `min_voxels`. Added are gaps of up to two voxels, which nobody passes and which
    would break surfaces into many boxes, and air that voxels and floor enclose: a scanned box is not hollow.
    Other space that was not seen stays free: under a table one may reach.

    Args:
        voxels: with the points of each. min_points: see above. min_voxels: see above.
        full: voxels known to be solid, such as the inside of a body.
        stood_in: the room that start and goal need; air that holds some of each is no inside, see `enclosed`.
    """
    count = voxels.count
    full = np.zeros(count.shape, dtype=bool) if full is None else full
    if not count.any():
        return full
    least = min_points or int(np.clip(np.median(count[count > 0]) // 4, 1, 3))
    fringe = FRINGE_SHARE * ndimage.maximum_filter(count, footprint=_NEIGHBOURS, mode="constant")
    kept = (count >= least) & (count >= fringe)
    group, groups = cast(tuple[NDArray[np.int32], int], ndimage.label(kept, _TOUCHING))
    large = np.bincount(group.ravel(), minlength=groups + 1) >= min_voxels
    large[0] = False
    return enclosed(closed(large[group] | full), stood_in)


def closed(solid: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """`solid` with gaps of up to two voxels filled: free is where a cube of three voxels fits between solid ones."""
    return solid | np.asarray(ndimage.binary_closing(np.pad(solid, 2), _TOUCHING), dtype=bool)[2:-2, 2:-2, 2:-2]


def enclosed(solid: NDArray[np.bool_], stood_in: Sequence[NDArray[np.bool_]] = ()) -> NDArray[np.bool_]:
    """`solid` and the air whose only ways out are holes of up to two voxels, the floor below layer 0 being closed.

    Air that reaches into each of the `stood_in` masks is the room that the robot walks in, and stays.
    """
    with_floor = _on_floor(solid)
    thick = _dilated(with_floor)
    inner = _filled(thick) & ~thick
    room = np.zeros_like(inner)
    if stood_in:
        air = cast(tuple[NDArray[np.int32], int], ndimage.label(inner))[0]
        shared = set(np.unique(air)) - {0}
        for mask in stood_in:
            shared &= set(np.unique(air[:, :, 1:][mask]))
        room = np.isin(air, list(shared))
    around = with_floor | _dilated(inner & ~room)
    filled = _filled(around)
    if room.any():
        gaps = cast(tuple[NDArray[np.int32], int], ndimage.label(filled & ~around))[0]
        filled &= ~np.isin(gaps, np.unique(gaps[room & (gaps > 0)]))
    return filled[:, :, 1:]


def _on_floor(solid: NDArray[np.bool_]) -> NDArray[np.bool_]:
    return np.pad(solid, ((0, 0), (0, 0), (1, 0)), constant_values=True)


def _dilated(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    return np.asarray(ndimage.binary_dilation(mask, _TOUCHING), dtype=bool)


def _filled(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    return np.asarray(ndimage.binary_fill_holes(mask), dtype=bool)


def cover_by_boxes(solid: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Boxes whose union is exactly `solid`: (B, 6) first and, exclusive, last voxel. Boxes may overlap.

    Greedy: from each voxel not yet covered the box is grown along the axes in every order, and the one that covers most
    new voxels stays. Overlap makes boxes larger and fewer than a partition has, and leaves fewer seams inside.
    """
    return _cover(np.ascontiguousarray(solid))


def column_extent(solid: NDArray[np.bool_], box: NDArray[np.int64]) -> tuple[int, int]:
    """First and, exclusive, last layer of what rises and hangs without a gap above and below a box.

    By it a box is judged to be on the ground or overhead: a table's leg is not on the ground where one of its boxes
    ends.
    """
    x0, y0, bottom, x1, y1, top = box
    layers = np.asarray(solid[x0:x1, y0:y1].any(axis=(0, 1)))
    while bottom > 0 and layers[bottom - 1]:
        bottom -= 1
    while top < len(layers) and layers[top]:
        top += 1
    return int(bottom), int(top)


@compiled
def _cover(solid):
    orders = ((0, 1, 2), (0, 2, 1), (1, 0, 2), (1, 2, 0), (2, 0, 1), (2, 1, 0))
    covered = np.zeros(solid.shape, dtype=np.bool_)
    boxes = np.empty((solid.size, 6), dtype=np.int64)
    found = 0
    for x in range(solid.shape[0]):
        for y in range(solid.shape[1]):
            for z in range(solid.shape[2]):
                if not solid[x, y, z] or covered[x, y, z]:
                    continue
                most = 0
                for order in orders:
                    box = _grown(solid, np.array([x, y, z, x + 1, y + 1, z + 1]), order)
                    new = (~covered[box[0] : box[3], box[1] : box[4], box[2] : box[5]]).sum()
                    if new > most:
                        most = new
                        boxes[found] = box
                best = boxes[found]
                covered[best[0] : best[3], best[1] : best[4], best[2] : best[5]] = True
                found += 1
    return boxes[:found].copy()


@compiled
def _grown(solid, box, order):
    for axis in order:
        for end, step in ((axis, -1), (axis + 3, 1)):
            while True:
                layer = box.copy()
                layer[axis] = box[axis] - 1 if step < 0 else box[axis + 3]
                layer[axis + 3] = layer[axis] + 1
                if layer[axis] < 0 or layer[axis] >= solid.shape[axis]:
                    break
                if not solid[layer[0] : layer[3], layer[1] : layer[4], layer[2] : layer[5]].all():
                    break
                box[end] += step
    return box
