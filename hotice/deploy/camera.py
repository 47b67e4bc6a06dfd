"""Pinhole camera: points to pixels. The head camera's numbers are nominal; a real one is calibrated."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray


@dataclass(frozen=True, kw_only=True)
class Camera:
    """Intrinsics of a camera without distortion: focal lengths and centre [px], size of the picture [px]."""

    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int

    def pixels(self, p_C: ArrayLike) -> NDArray[np.float64]:
        """Points (..., 3) in optical axes -> (..., 2) [px]; not a number for those that are not ahead."""
        x, y, z = np.moveaxis(np.asarray(p_C, dtype=float), -1, 0)
        depth = np.where(z > 0.0, z, np.nan)
        return np.stack([self.fx * x / depth + self.cx, self.fy * y / depth + self.cy], axis=-1)

    def inside(self, pixels: ArrayLike) -> NDArray[np.bool_]:
        """Whether pixels (..., 2) are in the picture, (...)."""
        u, v = np.moveaxis(np.asarray(pixels, dtype=float), -1, 0)
        return (u >= 0.0) & (u <= self.width - 1) & (v >= 0.0) & (v <= self.height - 1)


HEAD_CAMERA = Camera(fx=607.0, fy=607.0, cx=319.5, cy=239.5, width=640, height=480)
"""D435i, colour at 640×480: three public calibrations say 606.8, 606.9 and 610.3 px."""
