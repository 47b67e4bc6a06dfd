"""The box as its tags show it: newest sample of a source, the robot's own attitude and waist, a verdict each time."""

from __future__ import annotations

from collections import Counter

import numpy as np

from hotice.deploy.frames import WAIST, camera_in_pelvis
from hotice.deploy.messages.hg import JOINTS
from hotice.deploy.sources.protocol import Source
from hotice.deploy.sources.records import TagSample
from hotice.deploy.tags.box_pose import BoxPoser, BoxSighting, Verdict
from hotice.model.frames import quat_to_mat


class TagBox:
    """Solves each new sample once. A pose is in the pelvis, where a carried box stays while it is not seen."""

    def __init__(self, source: Source[TagSample], poser: BoxPoser) -> None:
        self._source, self._poser, self._number = source, poser, 0
        self.verdicts: Counter[Verdict] = Counter()
        """How often each was given."""
        self.newest: BoxSighting | None = None
        """Of the newest sample."""
        self.seen: BoxSighting | None = None
        """The last one with a pose."""
        self.seen_s = -np.inf
        """When its sample came, on the source's clock [s]."""

    def update(self, state: np.ndarray) -> BoxSighting | None:
        """The sighting of a new sample with a LowState (); None: there is no new one. Raises `LinkError` when closed.

        The state is the newest, not that of the exposure: a waist that turns at 0.5 rad/s is 25 mrad off after 50 ms.
        """
        received = self._source.newest()
        if received is None or received.number == self._number:
            return None
        self._number = received.number
        waist = state["motor_state"][JOINTS]["q"][list(WAIST)].astype(float)
        up_P = quat_to_mat(state["imu_state"]["quaternion"].astype(float))[2]
        sample = received.sample
        self.newest = self._poser.solve(sample.ids, sample.corners_px, camera_in_pelvis(waist), up_P)
        self.verdicts[self.newest.verdict] += 1
        if self.newest.X_PO is not None:
            self.seen, self.seen_s = self.newest, received.received_s
        return self.newest

    def age_s(self, now_s: float) -> float:
        """Since the box was last seen [s]; inf: never."""
        return now_s - self.seen_s
