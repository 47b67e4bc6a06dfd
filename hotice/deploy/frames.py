"""Frames on a robot's torso, seen from its pelvis: where its lidar and its head camera sit behind the measured waist.

P pelvis, T torso, L the lidar's IMU, which FAST-LIO reports, C the camera, optical axes: x right, y down, z ahead.
Places of lidar and camera: the maker's published description of revision 1.0, nominal; a real robot needs calibration.
"""

from __future__ import annotations

import math
from functools import cache
from typing import NamedTuple
from xml.etree import ElementTree

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hotice.errors import InvalidState
from hotice.model import g1
from hotice.model.frames import mat_to_quat, quat_from_axis_angle, quat_to_mat, rotation_y

Array = NDArray[np.float64]
WAIST = tuple(g1.ALL_JOINTS.index(joint) for joint in g1.WAIST_JOINTS)
"""Places of the waist's joints (yaw, roll, pitch) among the 29 of a message."""


class Pose(NamedTuple):
    """A pose X_AB: rotation (3, 3) from B's axes to A's, and the place of B's origin in A (3,) [m]."""

    R: Array
    p: Array

    @classmethod
    def of(cls, p: ArrayLike, quat: ArrayLike) -> Pose:
        """From a position [m] and a quaternion wxyz."""
        return cls(quat_to_mat(quat), np.asarray(p, dtype=float))

    def __matmul__(self, other: Pose) -> Pose:
        """X_AB @ X_BC = X_AC."""
        return Pose(self.R @ other.R, self.R @ other.p + self.p)

    @property
    def inverse(self) -> Pose:
        """X_BA."""
        return Pose(self.R.T, -self.R.T @ self.p)

    @property
    def quat(self) -> Array:
        """Its rotation as a quaternion wxyz, w ≥ 0, (4,)."""
        return mat_to_quat(self.R)

    def points(self, p_B: ArrayLike) -> Array:
        """Points (..., 3) in B -> (..., 3) in A [m]."""
        return np.asarray(p_B, dtype=float) @ self.R.T + self.p


_HALF_TURN = np.diag([1.0, -1.0, -1.0])
_LIDAR_PITCH, _CAMERA_PITCH = 0.0511, math.radians(47.6)
_R_LIDAR = rotation_y(_LIDAR_PITCH) @ _HALF_TURN
X_TL = Pose(_R_LIDAR, np.array([0.0003, 0.0, 0.4284]) + _R_LIDAR @ [0.011, 0.0233, -0.0441])
"""The lidar hangs upside down (roll π), tilted by 2.9°; its IMU is 5 cm from it (FAST-LIO's mid360.yaml)."""
_OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
X_TC = Pose(rotation_y(_CAMERA_PITCH) @ _OPTICAL, np.array([0.0576, 0.0175, 0.4299]))
"""The depth camera's frame, tilted down by 47.6°; its colour sensor sits beside it (factory extrinsics)."""


def torso_in_pelvis(waist: ArrayLike) -> Pose:
    """X_PT for measured angles of waist yaw, roll and pitch, (3,) [rad]. Raises `InvalidState`."""
    angles = np.asarray(waist, dtype=float)
    if angles.shape != (3,):
        raise InvalidState(f"waist has shape {angles.shape}: (3,) is needed, the angles of yaw, roll and pitch")
    pose = Pose(np.eye(3), np.zeros(3))
    for (place, axis), angle in zip(_waist_chain(), angles, strict=True):
        pose = pose @ Pose(quat_to_mat(quat_from_axis_angle(axis, angle)), place)
    return pose


def lidar_in_pelvis(waist: ArrayLike) -> Pose:
    """X_PL: the lidar's IMU, for a measured waist. Raises `InvalidState`."""
    return torso_in_pelvis(waist) @ X_TL


def camera_in_pelvis(waist: ArrayLike) -> Pose:
    """X_PC: the head camera, for a measured waist. Raises `InvalidState`."""
    return torso_in_pelvis(waist) @ X_TC


@cache
def _waist_chain() -> tuple[tuple[Array, Array], ...]:
    """Place in its parent and axis of each waist link, from the pelvis up; none is turned in its parent."""
    bodies = {b.attrib["name"]: b for b in ElementTree.parse(g1.xml_path()).getroot().iter("body")}
    chain = []
    for joint in g1.WAIST_JOINTS:
        (body,) = (b for b in bodies.values() if any(j.get("name") == joint for j in b.findall("joint")))
        (axis,) = (j.attrib["axis"] for j in body.findall("joint"))
        chain.append(tuple(np.array(text.split(), dtype=float) for text in (body.attrib["pos"], axis)))
    return tuple(chain)
