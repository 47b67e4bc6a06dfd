"""Tracking of the root between poses of localization, by the functions that students are trained with."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hotice.deploy.estimate.seen import SeenPose
from hotice.model.frames import rotation_z, yaw_from_quat
from hotice.policy.measuring import heading, root_at, track_gravity, track_root
from hotice.safety import PoseGate
from hotice.safety.jumps import AGREED, NEAR
from hotice.safety.limits import POSE_JUMP
from hotice.task.sensing import STUDENT_SENSING, TRACK_TILT

Array = NDArray[np.float64]
REFRESH_S = 1.0 / STUDENT_SENSING.root_hz
"""Time between two poses of localization, as trained [s]."""
GAP_S = 0.2
"""After so long without a state gravity is what is measured: what the gyro turned in between is not known."""


class RootTracker:
    """Place, heading and velocity of the root, and the direction of gravity.

    Attributes:
        root: (8,) see `hotice.policy.measuring.track_root`; None before the first pose.
        down_P: (3,) direction of gravity.
        tracked_s: when the last pose came that was near tracking [s]; accepted_s: that, or the last of five that agreed
            on another place.
        moved: whether poses insisted on another place, until `acknowledge`; verdict: of the newest pose.
    """

    def __init__(self, *, latency_s: float = 0.0) -> None:
        """`latency_s`: from a measurement of localization until its pose comes, as far as it is known [s]."""
        self._latency_s, self._gate = latency_s, PoseGate(POSE_JUMP)
        self._time_s = self._seen_s = -np.inf
        self._count = 0
        self._claim: Array | None = None
        self.tracked_s = -np.inf
        self.root: Array | None = None
        self.down_P, self.accepted_s, self.moved, self.verdict = np.array([0.0, 0.0, -1.0]), -np.inf, False, "none yet"

    def gravity(self, gravity_P: Array, w_WP_P: Array, now_s: float) -> float:
        """Takes over a measured direction of gravity (3,) and gyro (3,) [rad/s]; the time that passed [s]."""
        passed_s = now_s - self._time_s
        self._time_s = now_s
        if not passed_s <= GAP_S:
            self._count = 0
        dt_s = passed_s if self._count else 0.0
        gain = max(TRACK_TILT, 1.0 / (self._count + 1))
        self.down_P = track_gravity(self.down_P, gravity_P, w_WP_P, gain, dt_s)
        self._count += 1
        return passed_s

    def move(self, pose: SeenPose | None, w_WP_P: Array, passed_s: float, now_s: float) -> None:
        """Moves the root on by `passed_s` [s] and corrects it by the newest pose, if that is new; see `gravity`."""
        turning = -float(self.down_P @ w_WP_P)
        seen = self._new(pose)
        if self.root is None:
            if seen is not None:
                self._begin(seen)
            return
        ahead = track_root(self.root, None, turning, REFRESH_S, passed_s)
        if seen is None:
            self.root = ahead
            return
        late_s = self._latency_s if pose is None or pose.measured_s is None else now_s - pose.measured_s
        if late_s:
            seen = seen + np.array([*self.root[5:], turning]) * late_s
        known, newest = _flat(ahead[:3], heading(ahead)[0]), _flat(seen[:3], seen[3])
        self._gate.track(known[:3], known[3:])
        said = self._gate.judge(newest[:3], newest[3:])
        if said == NEAR:
            self.root = track_root(self.root, seen, turning, REFRESH_S, passed_s)
            self.accepted_s = self.tracked_s = self._seen_s
            self._claim = None
            return
        self.root, self.verdict = ahead, "elsewhere than tracking"
        if said == AGREED:
            self.moved = self.moved or self._claim is None
            self._claim, self.accepted_s = seen, self._seen_s

    def walk(self, p_WP: Array) -> None:
        """Puts the root where something else than poses carried it, (3,) [m]; its velocity is not known then."""
        assert self.root is not None
        self.root[:3], self.root[5:] = p_WP, 0.0

    def acknowledge(self) -> None:
        """Somebody knows of the dispute; tracking goes on all the same."""
        self.moved = False

    def settle(self) -> None:
        """Takes over the place on which poses insist, if they do."""
        self.moved = False
        if self._claim is not None:
            self._begin(self._claim)

    def _begin(self, seen: Array) -> None:
        self.root, self.accepted_s, self.tracked_s = root_at(seen), self._seen_s, self._seen_s
        self._claim = None

    def _new(self, pose: SeenPose | None) -> Array | None:
        """Place and heading (4,) of a pose that is new and good."""
        if pose is None or pose.received_s <= self._seen_s:
            return None
        self._seen_s, self.verdict = pose.received_s, pose.verdict
        return np.array([*pose.p, yaw_from_quat(pose.quat)]) if pose.good else None


def _flat(place: Array, yaw: float) -> Array:
    """A pose as a gate compares it, (12,): roll and pitch are the IMU's, and do not count."""
    return np.concatenate([place, rotation_z(float(yaw)).ravel()])
