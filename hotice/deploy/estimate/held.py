"""Tracking of the object in the pelvis' frame, where a carried one hardly moves: jumps refused, held while not seen."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hotice.deploy.estimate.seen import SeenPose
from hotice.model.frames import quat_to_mat
from hotice.policy.measuring import blend, right_angled
from hotice.safety import PoseGate
from hotice.safety.limits import BOX_JUMP

Array = NDArray[np.float64]


class HeldObject:
    """Low-pass filter of the object's pose, as trained.

    Attributes:
        pose: (3, 3) position [m] and first two axes in the pelvis; None before the first.
        accepted_s: when the last pose came that was believed [s]; verdict: of the newest pose.
    """

    def __init__(self, gain: float) -> None:
        """`gain`: weight of the newest pose at each step (`SensingConfig.object_gain`); the first are averaged."""
        self._gain, self._gate = gain, PoseGate(BOX_JUMP)
        self._newest: Array | None = None
        self._seen_s, self._count = -np.inf, 0
        self.pose: Array | None = None
        self.accepted_s, self.verdict = -np.inf, "none yet"

    def step(self, pose: SeenPose | None) -> None:
        """One control step with the newest pose, which may be that of the step before."""
        if pose is not None and pose.received_s > self._seen_s:
            self._seen_s, self.verdict = pose.received_s, pose.verdict
            if pose.good:
                self._take(pose)
        if self._newest is None:
            return
        gain = max(self._gain, 1.0 / (self._count + 1))
        self.pose = self._newest if self.pose is None else blend(self.pose, self._newest, gain)
        self._count += 1

    def _take(self, pose: SeenPose) -> None:
        R = quat_to_mat(pose.quat)
        if self._gate.accepts(pose.p, R):
            self._newest, self.accepted_s = np.vstack([pose.p, R[:, :2].T]), pose.received_s
        else:
            self.verdict = "jumped"

    @property
    def rotation(self) -> Array:
        """R_PO (3, 3) of the filtered pose."""
        assert self.pose is not None
        return right_angled(self.pose[1], self.pose[2])
