"""Tracking of obstacles that move: where they are taken to be now, from samples of their poses."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hotice.deploy.estimate.seen import OK
from hotice.deploy.past import measured_at
from hotice.deploy.sources.protocol import Source
from hotice.deploy.sources.records import MoverSample, scene_mark
from hotice.model.frames import quat_conj, quat_from_yaw, quat_mul
from hotice.model.moving.motion import FASTEST_M_S
from hotice.model.scene import Obstacle
from hotice.model.source import MapSource

Array = NDArray[np.float64]
FARTHEST_S = 1.0
"""Nobody is taken to go on for longer than this, nor by two places that are further apart in time (ours)."""

OUTSIDE_M = 1000.0
"""Nothing that is so far from the scene's origin is believed (ours)."""


class Moment(NamedTuple):
    """Poses (M, 7) in W, position [m] and quaternion wxyz, and when they were so, on the reader's clock [s]."""

    poses: Array
    measured_s: float


class MoverTracker:
    """Takes the newest sample; between samples all go on with the velocity of their last two places.

    That is what students are trained with (`hotice.model.moving.sight`). Who was faster than motions may be, 5 m/s, was
    put elsewhere, and stays there.

    Args:
        samples: of all that move, in the map
        moving: these obstacles of the scene
        source: of the scene, its place in the map; None: the scene is the map
        latency_s: from measurement to arrival, for a tracker whose clock is not ours [s]; see `measured_at`
    """

    def __init__(
        self,
        samples: Source[MoverSample],
        moving: Sequence[Obstacle],
        source: MapSource | None,
        *,
        latency_s: float = 0.0,
    ) -> None:
        self.moving = tuple(moving)
        self._samples, self._source, self._latency_s = samples, source, latency_s
        self._mark, self._number = scene_mark(o.name for o in self.moving), 0
        self._before: Moment | None = None
        self.newest: Moment | None = None
        """As they were seen last; None before the first."""
        self.verdict = "not seen yet"
        """Of the newest sample: "ok", or why it is not believed."""

    def look(self, now_s: float) -> None:
        """Takes what has come by `now_s` [s]."""
        received = self._samples.newest()
        if received is None or received.number == self._number:
            return
        self._number, sample = received.number, received.sample
        if (sample.scene, len(sample.poses_M)) != (self._mark, len(self.moving)):
            self.verdict = "of another scene"
            return
        measured_s = measured_at(sample.measured_s, received.received_s, now_s, self._latency_s)
        poses = self._in_scene(sample.poses_M)
        if (np.abs(poses[:, :3]) > OUTSIDE_M).any():
            self.verdict = f"more than {OUTSIDE_M:g} m away"
            return
        self.verdict = OK
        self._before, self.newest = self.newest, Moment(poses, measured_s)

    def age_s(self, now_s: float) -> float:
        """Since when they were as they were seen last [s]; infinite before the first time."""
        return math.inf if self.newest is None else now_s - self.newest.measured_s

    def poses(self, now_s: float) -> Array:
        """Where they are taken to be (M, 7), as `Moment.poses`. Raises `ValueError` before the first sample."""
        if self.newest is None:
            raise ValueError("no sample has come yet")
        poses, measured_s = self.newest
        passed_s = 0.0 if self._before is None else measured_s - self._before.measured_s
        if self._before is None or not 0.0 < passed_s <= FARTHEST_S:
            return poses
        parts = min(max(now_s - measured_s, 0.0), FARTHEST_S) / passed_s
        way = poses[:, :3] - self._before.poses[:, :3]
        jumped = np.linalg.norm(way, axis=1) > FASTEST_M_S * passed_s
        step = quat_mul(poses[:, 3:], quat_conj(self._before.poses[:, 3:]))
        turn = np.array([math.remainder(2.0 * math.atan2(z, w), 2.0 * math.pi) for w, _, _, z in step.tolist()])
        gone = np.where(jumped, 0.0, parts)
        return np.hstack([poses[:, :3] + gone[:, None] * way, quat_mul(quat_from_yaw(gone * turn), poses[:, 3:])])

    def _in_scene(self, poses_M: Array) -> Array:
        if self._source is None:
            return poses_M
        return np.array([np.concatenate(self._source.pose_to_scene(pose[:3], pose[3:])) for pose in poses_M])
