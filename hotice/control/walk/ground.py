"""Obstacles on the floor: how high a sole must be to pass over them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hotice.model.scene import Scene

Array = NDArray[np.float64]
SOLE_FRONT_M, SOLE_BACK_M, SOLE_HALF_WIDTH_M = 0.142, 0.066, 0.038
"""Extent of the sole about the ankle."""
HIGHEST_M = 0.30
LEVELS_M = np.arange(0.01, HIGHEST_M + 1e-9, 0.01)
_OUTLINE = np.stack(
    np.meshgrid(np.linspace(-SOLE_BACK_M, SOLE_FRONT_M, 9), np.array([-1.0, 0.0, 1.0]) * SOLE_HALF_WIDTH_M), axis=-1
).reshape(-1, 2)


class Ground:
    """Ground obstacles of a scene under soles, from the signed distance of its obstacles.

    `sole_height` is exact where the signed distance is; obstacles that end above `HIGHEST_M` cannot be stepped over.
    """

    def __init__(self, scene: Scene, margin_m: float) -> None:
        self.scene = scene
        self.margin_m = margin_m

    def sole_height(self, xy: Array, yaw: Array | float) -> Array:
        """Least height of level soles with the ankle at xy (N, 2) [m], yaw (N,) or one [rad] -> (N,) [m].

        0 where the sole may stand; `HIGHEST_M` or more where nothing of that height is free.
        """
        xy = np.atleast_2d(np.asarray(xy, dtype=float))
        if not self.scene.obstacles:
            return np.zeros(len(xy))
        yaw = np.broadcast_to(np.asarray(yaw, dtype=float), len(xy))
        c, s = np.cos(yaw)[:, None], np.sin(yaw)[:, None]
        x = xy[:, :1] + c * _OUTLINE[:, 0] - s * _OUTLINE[:, 1]
        y = xy[:, 1:] + s * _OUTLINE[:, 0] + c * _OUTLINE[:, 1]
        shape = (len(LEVELS_M), *x.shape)
        p = np.stack(
            [np.broadcast_to(x, shape), np.broadcast_to(y, shape), np.broadcast_to(LEVELS_M[:, None, None], shape)],
            axis=-1,
        )
        free = (self.scene.signed_distance(p.reshape(-1, 3)).reshape(shape) >= self.margin_m).all(axis=2)
        blocked = np.logical_not(free)
        highest = np.where(blocked.any(axis=0), len(LEVELS_M) - np.argmax(blocked[::-1], axis=0), 0)
        return np.where(highest > 0, LEVELS_M[np.minimum(highest, len(LEVELS_M)) - 1] + 0.01, 0.0)
