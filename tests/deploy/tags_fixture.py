"""A box with printed tags before the head camera of a robot that stands upright."""

from __future__ import annotations

from functools import cache

import numpy as np

from hotice.deploy.camera import HEAD_CAMERA
from hotice.deploy.frames import Pose, camera_in_pelvis
from hotice.deploy.tags.rendering import BoxPictures, Picture, printed
from hotice.model.frames import quat_from_axis_angle
from hotice.model.objects import Box

BOX = Box((0.3, 0.3, 0.25), 1.5)
UP = np.array([0.0, 0.0, 1.0])
X_PC = camera_in_pelvis(np.zeros(3))
CARRY, PICK_UP = (0.2457, 0.0, 0.099), (0.55, 0.0, 0.0)
"""Places of the carried box, and of one on a table before the robot, in the pelvis [m]."""


def near_pose(rng: np.random.Generator, place=CARRY, *, spread_m: float = 0.03, angle_rad: float = 0.15) -> Pose:
    """X_PO: a box near a place, turned a little about any axis."""
    quat = quat_from_axis_angle(rng.normal(size=3), rng.uniform(-angle_rad, angle_rad))
    return Pose.of(np.array(place) + rng.uniform(-spread_m, spread_m, 3), quat)


def angle_deg(R_AB: np.ndarray, R_AC: np.ndarray) -> float:
    """Between two rotations."""
    return float(np.degrees(2.0 * np.arcsin(min(1.0, np.linalg.norm(R_AB - R_AC) / np.sqrt(8.0)))))


@cache
def pictures(printing=printed) -> BoxPictures:
    return BoxPictures(BOX, HEAD_CAMERA, printing=printing)


def take(X_PO: Pose, rng: np.random.Generator, *, printing=printed, **options) -> Picture:
    return pictures(printing).take(X_PC.inverse @ X_PO, rng, **options)
