"""What a source says of one pose, and the protocol of who reads it."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from hotice.deploy.past import Past

Array = NDArray[np.float64]
OK = "ok"
NOWHERE = np.full(3, np.nan)


class SeenPose(NamedTuple):
    """A pose that a source gave: position (3,) [m], quaternion (4,) wxyz, and when it came [s]."""

    p: Array
    quat: Array
    received_s: float
    """The same time is the same pose."""
    verdict: str = OK
    """Anything else says why it is none."""
    measured_s: float | None = None
    """When it was measured, on the reader's clock [s]; None: not known."""

    @property
    def good(self) -> bool:
        """Whether it is a pose."""
        return self.verdict == OK and bool(np.isfinite(self.p).all() and np.isfinite(self.quat).all())


class Look(Protocol):
    """Reads the newest pose of a source."""

    def __call__(self, past: Past, now_s: float) -> SeenPose | None:
        """The pose, by what waist and attitude were when it was measured; None before the first. `now_s`: [s]."""
        ...


def nothing(received_s: float, verdict: str) -> SeenPose:
    """What a source says when it has no pose, and why."""
    return SeenPose(NOWHERE, np.full(4, np.nan), received_s, verdict)
