"""The pelvis in the scene, from where localization has the lidar in its map."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from hotice.deploy.estimate.seen import SeenPose, nothing
from hotice.deploy.frames import Pose, lidar_in_pelvis
from hotice.deploy.past import Past, measured_at
from hotice.deploy.sources.protocol import Source
from hotice.deploy.sources.records import PoseSample
from hotice.model.frames import normalize
from hotice.model.source import MapSource

Array = NDArray[np.float64]
MOST_LEAN_RAD = math.radians(8.0)
"""Between up of map and lidar, and up of the IMU: beyond, map or mount is wrong (ours; the trained noise of gravity is
3 degrees)."""


class LidarPelvis:
    """Looks at localization, see `Look`: scene ← map ← lidar's IMU ← waist ← pelvis.

    Args:
        poses: of the lidar's IMU in the map
        source: of the scene, its place in the map; None: the scene is the map
        latency_s: from measurement to arrival, for a lidar whose clock is not ours [s]; see `measured_at`
    """

    def __init__(self, poses: Source[PoseSample], source: MapSource | None, *, latency_s: float = 0.0) -> None:
        self._poses, self._source, self._latency_s = poses, source, latency_s
        self._seen: SeenPose | None = None

    def __call__(self, past: Past, now_s: float) -> SeenPose | None:
        received = self._poses.newest()
        if received is None or (self._seen is not None and received.received_s == self._seen.received_s):
            return self._seen
        sample = received.sample
        measured_s = measured_at(sample.measured_s, received.received_s, now_s, self._latency_s)
        torso = past.at(measured_s)
        X_WP = pelvis_in_scene(sample, self._source, torso.waist)
        lean = math.acos(min(1.0, float(X_WP.R[2] @ normalize(torso.up_P))))
        if lean > MOST_LEAN_RAD:
            said = f"leans {math.degrees(lean):.0f} degrees against gravity: map or mount is wrong"
            self._seen = nothing(received.received_s, said)
        else:
            self._seen = SeenPose(X_WP.p, X_WP.quat, received.received_s, measured_s=measured_s)
        return self._seen


def pelvis_in_scene(sample: PoseSample, source: MapSource | None, waist: Array) -> Pose:
    """X_WP of a sample, for a measured waist (3,) [rad]; source None: the scene is the map."""
    p, quat = (sample.p_ML, sample.quat_ML) if source is None else source.pose_to_scene(sample.p_ML, sample.quat_ML)
    return Pose.of(p, quat) @ lidar_in_pelvis(waist).inverse
