"""The local obstacle scan: where a policy may look for obstacles beside its keypoints.

The fields tell which way to go and how near the nearest obstacle is; where a foot may land, and how low a beam is, they
show only once it is within d0. The scan reads the signed distance at fixed points ahead: on two heights along the way
of each foot, and on three before the upper body. NumPy or torch: training and deployment read the same numbers.
"""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np

from hotice.arrays import clip, namespace, picked

FOOT_AHEAD_M = (-0.25, -0.125, 0.0, 0.125, 0.25, 0.375, 0.5)
FOOT_HEIGHTS_M = (0.02, 0.12)
BODY_AHEAD_M = (0.0, 0.2, 0.4, 0.6)
BODY_HEIGHTS_M = (0.9, 1.05, 1.2)
FAR_M, SCALE_M, MOST = 0.3, 0.1, 3.5


def _pairs(ahead: tuple[float, ...], heights: tuple[float, ...]) -> np.ndarray:
    return np.array(list(itertools.product(heights, ahead)))[:, ::-1]


FOOT_POINTS = _pairs(FOOT_AHEAD_M, FOOT_HEIGHTS_M)
"""(14, 2): metres ahead of a foot along the heading, and height over the floor."""
BODY_POINTS = _pairs(BODY_AHEAD_M, BODY_HEIGHTS_M)
"""(12, 2): the same ahead of the pelvis."""
NUM_SCAN = 2 * len(FOOT_POINTS) + len(BODY_POINTS)
"""Points: left foot, right foot, body."""
ORIGIN = np.repeat([0, 1, 2], [len(FOOT_POINTS), len(FOOT_POINTS), len(BODY_POINTS)])
"""(40,): what each point goes with: 0 left foot, 1 right foot, 2 pelvis."""
OFFSETS_M = np.concatenate([FOOT_POINTS, FOOT_POINTS, BODY_POINTS])
"""(40, 2): metres ahead along the heading, height over the floor."""


def scan_points(feet_W: Any, p_WP: Any, yaw: Any) -> Any:
    """Where robots look, (..., 40, 3) in W [m]: ahead of feet and pelvis along the heading, at fixed heights.

    Args:
        feet_W: (..., 2, 3) left and right foot [m]. p_WP: (..., 3) pelvis [m]. yaw: (...) its heading [rad].
    """
    xp = namespace(p_WP)
    offsets = OFFSETS_M if xp is np else xp.as_tensor(OFFSETS_M, dtype=p_WP.dtype, device=p_WP.device)
    # of one robot `stack` costs NumPy four times as much
    heading = xp.concat([xp.cos(yaw)[..., None], xp.sin(yaw)[..., None]], -1)
    points = picked(xp.concat([feet_W, p_WP[..., None, :]], -2), ORIGIN)
    points[..., :2] += heading[..., None, :] * offsets[:, :1]
    points[..., 2] = offsets[:, 1]
    return points


def nearness(distance_m):
    """Signed distances [m] as the policy reads them: 0 from 30 cm on, 3 at a surface; numpy array or torch tensor."""
    return clip((FAR_M - distance_m) / SCALE_M, 0.0, MOST)
