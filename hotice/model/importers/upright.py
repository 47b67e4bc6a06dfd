"""Which way up a cloud is: a lidar that hangs upside down maps the floor above the ceiling.

Things stand on a floor and rise from it; below it is nothing. Both ways up are fitted and compared by the cells that agree with
each: those that rise from its floor, but not from its ceiling as walls do, and those that would lie under the other's floor.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hotice.errors import InvalidMap
from hotice.model.importers.floor import CELL_M, Floor, fit_floor, thinned

Points = NDArray[np.float64]
TURNED = np.diag([1.0, -1.0, -1.0])
"""Half a turn about x: what `--up=-z` does."""
SAME_M = 0.15
"""Two floors this near are one, seen from both sides."""
RISES_M = (0.1, 1.0)
BEYOND_M = (0.1, 2.5)
CLEAR, FEWEST = 0.2, 60
"""One way up is clear when it leads by this share of at least so many cells."""
SENSOR_M = (0.3, 3.0)
"""A map that begins at its sensor has its origin this high above the floor."""


def fit_upright(p_M: Points) -> tuple[bool, Floor]:
    """Whether points (n, 3) [m] are upside down, and their floor in the frame that stands upright (z or `TURNED`).

    A map that tells nothing (a bare floor) is taken as it is. Raises `InvalidMap` where there is no floor, or where as much
    speaks for one way up as for the other.
    """
    fits = []
    for turn in (np.eye(3), TURNED):
        try:
            fits.append(fit_floor(p_M @ turn))
        except InvalidMap as error:
            fits.append(error)
    if all(isinstance(fit, InvalidMap) for fit in fits):
        raise fits[0]
    for down, fit in enumerate(fits):
        if isinstance(fits[1 - down], InvalidMap):
            return bool(down), fit
    up, down = fits
    z, z_down = up.to_world(thinned(p_M, CELL_M)), down.to_world(thinned(p_M, CELL_M) @ TURNED)
    ceiling = float(np.median(z[:, 2] + z_down[:, 2]))  # height of the other floor above this one
    for_up, for_down = _evidence(z, z_down, ceiling)
    lead, total = for_up - for_down, for_up + for_down
    sensor = up.to_world(np.zeros(3))[2]
    seen = SENSOR_M[0] <= abs(sensor) <= SENSOR_M[1] and abs(ceiling) < SAME_M
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


def _evidence(p_up: Points, p_down: Points, ceiling_m: float) -> tuple[int, int]:
    """Cells that speak for either way up; the same points (n, 3) in both frames."""
    if abs(ceiling_m) < SAME_M:
        return _count(p_up[:, 2], BEYOND_M), _count(p_down[:, 2], BEYOND_M)
    rising, hanging = (_within(p[:, 2], (RISES_M[0], min(RISES_M[1], 0.5 * abs(ceiling_m)))) for p in (p_up, p_down))
    column = np.floor(p_up[:, :2] / CELL_M).astype(np.int64)
    _, column = np.unique(column, axis=0, return_inverse=True)
    stands, hangs = (np.bincount(column, kind) > 0 for kind in (rising, hanging))
    for_up = (rising & ~hangs[column]).sum() + _count(-p_down[:, 2], BEYOND_M)
    for_down = (hanging & ~stands[column]).sum() + _count(-p_up[:, 2], BEYOND_M)
    return int(for_up), int(for_down)


def _within(z: NDArray[np.float64], span: tuple[float, float]) -> NDArray[np.bool_]:
    return (z > span[0]) & (z < span[1])


def _count(z: NDArray[np.float64], span: tuple[float, float]) -> int:
    return int(_within(z, span).sum())
