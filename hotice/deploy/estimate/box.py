"""The box in the pelvis, from the tags that the head camera finds on it."""

from __future__ import annotations

from hotice.deploy.estimate.seen import SeenPose, nothing
from hotice.deploy.frames import camera_in_pelvis
from hotice.deploy.past import Past, measured_at
from hotice.deploy.sources.protocol import Source
from hotice.deploy.sources.records import TagSample
from hotice.deploy.tags import BoxPoser


class TaggedBox:
    """Looks at the tags of one box, see `Look`; a picture without them says so, and is no pose."""

    def __init__(self, tags: Source[TagSample], poser: BoxPoser, *, latency_s: float = 0.0) -> None:
        """`latency_s`: from exposure to arrival, for a camera whose clock is not ours [s]; see `measured_at`."""
        self._tags, self._poser, self._latency_s = tags, poser, latency_s
        self._seen: SeenPose | None = None

    def __call__(self, past: Past, now_s: float) -> SeenPose | None:
        received = self._tags.newest()
        if received is None or (self._seen is not None and received.received_s == self._seen.received_s):
            return self._seen
        sample = received.sample
        torso = past.at(measured_at(sample.measured_s, received.received_s, now_s, self._latency_s))
        sighting = self._poser.solve(sample.ids, sample.corners_px, camera_in_pelvis(torso.waist), torso.up_P)
        if sighting.X_PO is None:
            self._seen = nothing(received.received_s, sighting.verdict)
        else:
            self._seen = SeenPose(sighting.X_PO.p, sighting.X_PO.quat, received.received_s)
        return self._seen
