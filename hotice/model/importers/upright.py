"""Upright direction of a cloud: a lidar that hangs upside down maps the floor above the ceiling.

Things stand on a floor and rise from it; below it is nothing. Both ways up are fitted and compared by the cells that
agree with
each: those that rise from its floor, but not from its ceiling as walls do, and those that lie under the other's floor.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, convolve1d

from hotice.errors import InvalidMap
from hotice.model.importers.floor import CELL_M, Floor, fit_floor, thinned

Points = NDArray[np.float64]
TURNED = np.diag([1.0, -1.0, -1.0])
"""Half a turn about x: what `--up=-z` does."""
SAME_M = 0.15
"""Two floors this near are one, seen from both sides."""
GAP_M, RISES_M, BEYOND_M = 0.1, 1.0, 2.5
"""What stands on a floor begins this far above it, and is looked for up to so high; what lies under it, down to so
deep."""
NEIGHBOURS = 4
"""A cell with fewer of its 26 neighbours holds a stray; in dense clouds so does one of few points."""
CLEAR, FEWEST = 1.0 / 3.0, 60
"""One way up is clear when it leads by this share (twice as many) of at least so many cells."""
SENSOR_M = (0.3, 3.0)
"""A map that begins at its sensor has its origin this high above the floor."""


def clearly_upright(p_W: Points) -> bool:
    """Whether things rise from the floor z = 0 of points (n, 3) [m], twice as many as hang from a ceiling at least."""
    ceiling = 0.0
    try:
        down = fit_floor(p_W @ TURNED)
        ceiling = float(np.median(p_W[:, 2] + down.to_world(p_W @ TURNED)[:, 2]))
    except InvalidMap:
        pass
    for_up, for_down = _evidence(p_W, ceiling)
    return for_up + for_down >= FEWEST and for_up - for_down >= CLEAR * (for_up + for_down)


def fit_upright(p_M: Points) -> tuple[bool, Floor]:
    """Whether points (n, 3) [m] are upside down, and their floor in the frame that stands upright (z or `TURNED`).

    A map that tells nothing (a bare floor) is taken as it is. Raises `InvalidMap` where there is no floor, or where as
    much speaks for one way up as for the other.
    """
    fits, thin = [], thinned(p_M, CELL_M)
    for turn in (np.eye(3), TURNED):
        try:
            fits.append(fit_floor(p_M @ turn, thin=thin @ turn))
        except InvalidMap as error:
            fits.append(error)
    if all(isinstance(fit, InvalidMap) for fit in fits):
        raise fits[0]
    for down, fit in enumerate(fits):
        if isinstance(fits[1 - down], InvalidMap):
            return bool(down), fit
    up, down = fits
    ceiling = float(np.median(up.to_world(thin)[:, 2] + down.to_world(thin @ TURNED)[:, 2]))
    for_up, for_down = _evidence(up.to_world(p_M), ceiling)
    lead, total = for_up - for_down, for_up + for_down
    sensor = up.to_world(np.zeros(3))[2]
    seen = SENSOR_M[0] <= abs(sensor) <= SENSOR_M[1] and ceiling < SAME_M
    if total >= FEWEST and abs(lead) >= CLEAR * total:
        upside_down = lead < 0
    elif seen:
        upside_down = sensor < 0.0
    elif total < FEWEST:
        upside_down = False
    else:
        raise InvalidMap(
            "as much speaks for the map being upside down as for its being upright: say which by --up=z or --up=-z"
        )
    return upside_down, down if upside_down else up


def _evidence(p_W: Points, ceiling_m: float) -> tuple[int, int]:
    """Numbers of cells that speak for z and for -z.

    p_W: points (n, 3) above the lowest large level; the highest is at `ceiling_m`.
    """
    low, high = 0.0, max(ceiling_m, 0.0)
    near = p_W[(p_W[:, 2] > low - BEYOND_M) & (p_W[:, 2] < high + BEYOND_M)]
    origin = near.min(axis=0)
    cell = ((near - origin) / CELL_M).astype(np.int64)
    shape = tuple(cell.max(axis=0) + 1)
    count = np.bincount(np.ravel_multi_index(tuple(cell.T), shape), minlength=int(np.prod(shape))).reshape(shape)
    solid = (count >= np.clip(np.median(count[count > 0]) // 4, 1, 3)).astype(np.uint8)
    around = solid
    for axis in range(3):
        around = convolve1d(around, np.ones(3, dtype=np.uint8), axis=axis, mode="constant")
    solid = (solid > 0) & (around > NEIGHBOURS)
    z = origin[2] + CELL_M * (np.arange(solid.shape[2]) + 0.5)
    under, over = (int(solid[:, :, mask].sum()) for mask in (z < low - GAP_M, z > high + GAP_M))
    if high < SAME_M:
        return over, under
    stands = _standing(solid[:, :, (z > low + GAP_M) & (z < low + RISES_M) & (z < high - GAP_M)])
    hangs = _standing(solid[:, :, (z < high - GAP_M) & (z > high - RISES_M) & (z > low + GAP_M)][:, :, ::-1])
    beside = [np.asarray(binary_dilation(part > 0, np.ones((3, 3))), dtype=bool) for part in (stands, hangs)]
    rises, falls = int(stands[~beside[1]].sum()), int(hangs[~beside[0]].sum())
    return rises + over, falls + under


def _standing(solid: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Cells of each column that rise from its first two layers, gaps of one allowed, (nx, ny); 0 for fewer than two."""
    closed = solid.copy()
    closed[:, :, 1:-1] |= solid[:, :, :-2] & solid[:, :, 2:]
    closed[:, :, :1] |= solid[:, :, 1:2]
    height = np.logical_and.accumulate(closed, axis=2).sum(axis=2)
    return np.where(height > 1, height, 0)
