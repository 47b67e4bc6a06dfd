"""Past of the robot's attitude and waist: what a camera or lidar on the torso saw belongs to when it was measured."""

from __future__ import annotations

from bisect import bisect_right
from collections import deque
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hotice.deploy.frames import WAIST
from hotice.deploy.messages.hg import JOINTS
from hotice.model.frames import normalize, quat_to_mat

Array = NDArray[np.float64]
REMEMBERED = 64
"""States that are kept: more than a second of a runner's, which reads 50 a second."""
OLDEST_S = 1.0
"""A sample whose own time is further back than this, or not yet, was stamped by another clock than the reader's."""


class Torso(NamedTuple):
    """What a state says of the torso: angles of the waist (3,) [rad], and up (3,) in the pelvis."""

    waist: Array
    up_P: Array

    @classmethod
    def of(cls, state: np.ndarray) -> Torso:
        """Of a LowState ()."""
        waist = state["motor_state"]["q"][JOINTS][list(WAIST)].astype(float)
        return cls(waist, quat_to_mat(normalize(state["imu_state"]["quaternion"].astype(float)))[2])


class Past:
    """Ring of the last states' torsos by time, on the clock of who reads."""

    def __init__(self) -> None:
        self._times: deque[float] = deque(maxlen=REMEMBERED)
        self._torsos: deque[Torso] = deque(maxlen=REMEMBERED)

    def add(self, torso: Torso, time_s: float) -> None:
        """A torso as it was at `time_s` [s]; one that is not later than the last takes its place."""
        if self._times and time_s <= self._times[-1]:
            self._times.pop()
            self._torsos.pop()
            # a clock that ran backwards: what was before is of another time
            if self._times and time_s <= self._times[-1]:
                self._times.clear()
                self._torsos.clear()
        self._times.append(time_s)
        self._torsos.append(torso)

    @property
    def newest(self) -> Torso:
        """The last that was added."""
        return self._torsos[-1]

    def at(self, time_s: float) -> Torso:
        """The torso at a time [s], linearly between two states; the first or last one for a time beyond them."""
        after = bisect_right(self._times, time_s)
        if after == 0:
            return self._torsos[0]
        if after == len(self._times):
            return self._torsos[-1]
        early, late = self._torsos[after - 1], self._torsos[after]
        share = (time_s - self._times[after - 1]) / (self._times[after] - self._times[after - 1])
        return Torso(*(a + share * (b - a) for a, b in zip(early, late, strict=True)))


def measured_at(measured_s: float, received_s: float, now_s: float, latency_s: float = 0.0) -> float:
    """When a sample was measured, on the reader's clock [s].

    Its own time, if that is the reader's: a camera's or lidar's program on the same machine stamps by the machine's
    monotonic clock. Else `latency_s` [s] before it came, as far as that is known.
    """
    return measured_s if 0.0 <= now_s - measured_s <= OLDEST_S else received_s - latency_s
