"""Axis-aligned extents of obstacles, and the category that follows from their height."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from hotice.model.frames import quat_to_mat
from hotice.model.geometry.shapes import BoxShape, CapsuleShape, CylinderShape, MeshShape, SphereShape
from hotice.model.scene import Obstacle

GROUND_TOP_M = 0.15
"""Height [m] below which an obstacle's top can be stepped over: category ground."""
OVERHEAD_BOTTOM_M = 1.0
"""Height [m] above which an obstacle's underside can be ducked under: category overhead."""


def category_by_height(bottom_m: float, top_m: float) -> str:
    """Category of what reaches from `bottom_m` to `top_m` above the floor: ground, overhead, else side."""
    if top_m <= GROUND_TOP_M:
        return "ground"
    return "overhead" if bottom_m >= OVERHEAD_BOTTOM_M else "side"


def extent(obstacle: Obstacle) -> NDArray[np.float64]:
    """Lowest and highest corner of the tight box along the axes of W that holds the obstacle, (2, 3) [m]."""
    R_WB, shape = quat_to_mat(obstacle.quaternion_wxyz), obstacle.shape
    if isinstance(shape, MeshShape):
        p_W = shape.mesh().vertices @ R_WB.T + obstacle.position_m
        return np.array([p_W.min(axis=0), p_W.max(axis=0)])
    along_z = np.abs(R_WB[:, 2])
    match shape:
        case BoxShape():
            half = 0.5 * np.abs(R_WB) @ shape.size_m
        case CylinderShape():
            half = 0.5 * shape.length_m * along_z + shape.radius_m * np.sqrt(np.maximum(1.0 - along_z**2, 0.0))
        case CapsuleShape():
            half = 0.5 * shape.length_m * along_z + shape.radius_m
        case SphereShape():
            half = np.full(3, shape.radius_m)
        case _:
            raise TypeError(f"no extent is known for a {shape.type} shape")
    return np.array([obstacle.position_m - half, obstacle.position_m + half])


def union(extents: Iterable[NDArray[np.float64]]) -> NDArray[np.float64]:
    """The box that holds all boxes (2, 3)."""
    stacked = np.stack(list(extents))
    return np.array([stacked[:, 0].min(axis=0), stacked[:, 1].max(axis=0)])
