"""The grid over a scene's bounds.

Values sit at cell centres, `p_W = origin + index * resolution` with `origin = bounds_min + resolution / 2` and
`shape = floor(extent / resolution + 1/2)`; the defaults give 75 x 50 x 38.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hotice import checks
from hotice.errors import InvalidConfig
from hotice.model.scene import MAX_GRID_NODES, Scene


@dataclass(frozen=True)
class Grid:
    """Cell centres `origin + index * resolution_m`; `shape` in cells."""

    origin: NDArray[np.float64]
    shape: tuple[int, int, int]
    resolution_m: float

    @classmethod
    def of(cls, scene: Scene, resolution_m: float) -> Grid:
        """The grid over the scene's bounds. Raises `InvalidConfig` for an impossible resolution."""
        h = checks.number("resolution_m", resolution_m, checks.POSITIVE)
        low, high = np.array(scene.bounds_m)
        cells = np.floor((high - low) / h + 0.5)
        if cells.min() < 3 or cells.prod() > MAX_GRID_NODES:
            raise InvalidConfig(
                f"resolution_m {h} gives scene {scene.name!r} a grid of {' x '.join(f'{c:.0f}' for c in cells)} nodes: "
                f"at least 3 along each axis and at most {MAX_GRID_NODES:,} in all are allowed"
            )
        nx, ny, nz = (int(c) for c in cells)
        return cls(low + 0.5 * h, (nx, ny, nz), h)

    @property
    def size(self) -> int:
        """Number of nodes."""
        return self.shape[0] * self.shape[1] * self.shape[2]

    def points(self, index: NDArray[np.integer] | None = None) -> NDArray[np.float64]:
        """Positions of the nodes of these flat indices (all when None), (n, 3) in W [m]; z runs fastest."""
        flat = np.arange(self.size) if index is None else index
        return self.origin + np.stack(np.unravel_index(flat, self.shape), axis=-1) * self.resolution_m
