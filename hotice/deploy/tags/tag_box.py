"""The box as its tags show it: newest sample of a source, the robot's own attitude and waist, a verdict each time."""

from __future__ import annotations

from collections import Counter

import numpy as np

from hotice.deploy.frames import camera_in_pelvis
from hotice.deploy.past import Past, Torso, measured_at
from hotice.deploy.sources.protocol import Source
from hotice.deploy.sources.records import TagSample
from hotice.deploy.tags.box_pose import BoxPoser, BoxSighting, Verdict


class TagBox:
    """Solves each new sample once. A pose is in the pelvis, where a carried box stays while it is not seen."""

    def __init__(self, source: Source[TagSample], poser: BoxPoser, *, latency_s: float = 0.0) -> None:
        """`latency_s`: from exposure to arrival, for a camera whose clock is not ours [s]; see `measured_at`."""
        self._source, self._poser, self._number = source, poser, 0
        self._past, self._latency_s = Past(), latency_s
        self.verdicts: Counter[Verdict] = Counter()
        """How often each was given."""
        self.newest: BoxSighting | None = None
        """Of the newest sample."""
        self.seen: BoxSighting | None = None
        """The last one with a pose."""
        self.seen_s = -np.inf
        """When its sample came, on the source's clock [s]."""

    def update(self, state: np.ndarray, now_s: float) -> BoxSighting | None:
        """The sighting of a new sample; None: there is no new one. Call it with every LowState () that is read.

        The sample counts with the state of its exposure: a waist that turns at 0.5 rad/s is 25 mrad off after 50 ms.
        `now_s`: on the source's clock [s]. Raises `LinkError` when closed.
        """
        self._past.add(Torso.of(state), now_s)
        received = self._source.newest()
        if received is None or received.number == self._number:
            return None
        self._number = received.number
        sample = received.sample
        torso = self._past.at(measured_at(sample.measured_s, received.received_s, now_s, self._latency_s))
        self.newest = self._poser.solve(sample.ids, sample.corners_px, camera_in_pelvis(torso.waist), torso.up_P)
        self.verdicts[self.newest.verdict] += 1
        if self.newest.X_PO is not None:
            self.seen, self.seen_s = self.newest, received.received_s
        return self.newest

    def age_s(self, now_s: float) -> float:
        """Since the box was last seen [s]; inf: never."""
        return now_s - self.seen_s
