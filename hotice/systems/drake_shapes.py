"""Shapes and poses of the project as Drake's."""

# pydrake's stubs type arrays as numpy does not:
# pyright: reportArgumentType=false, reportCallIssue=false

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import ArrayLike
from pydrake.common.eigen_geometry import Quaternion
from pydrake.geometry import Box, Capsule, Cylinder, Shape, Sphere
from pydrake.math import RigidTransform, RotationMatrix


def primitive(kind: str, size: ArrayLike) -> Shape:
    """Drake's shape of a MuJoCo primitive: half extents, or radius and half length along z [m]."""
    size = [float(v) for v in np.asarray(size)]
    if kind == "box":
        return Box(*(2.0 * v for v in size[:3]))
    if kind == "sphere":
        return Sphere(size[0])
    return {"cylinder": Cylinder, "capsule": Capsule}[kind](size[0], 2.0 * size[1])


def shape_of(model: mujoco.MjModel, geom: int) -> Shape:
    """Drake's shape of a geom of a compiled model."""
    kind = mujoco.mjtGeom(int(model.geom_type[geom])).name.removeprefix("mjGEOM_").lower()
    return primitive(kind, model.geom_size[geom])


def pose(position: ArrayLike, quat: ArrayLike) -> RigidTransform:
    """Pose of a position (3,) [m] and a quaternion (4,) wxyz, which is made unit."""
    w = np.asarray(quat, dtype=float)
    return RigidTransform(RotationMatrix(Quaternion(w / np.linalg.norm(w))), np.asarray(position, dtype=float))
