"""The robot's state as the guard believes it: the newest possible one, its age, and how many in a row were refused."""

from __future__ import annotations

import numpy as np

from hotice.deploy.guard.limits import GuardLimits
from hotice.deploy.link.protocol import LinkCounts, ReceivedState
from hotice.deploy.messages.hg import JOINTS


def jumped(q: np.ndarray, before: np.ndarray, passed_s: float, limits: GuardLimits) -> np.ndarray:
    """Which joints (29,) are further from where they were than their speed allows: an encoder that slipped."""
    return ~(np.abs(q - before) <= limits.jump_rad + limits.joint_rad_s * passed_s)


class Measured:
    """Takes states as they come; an impossible one is dropped like a damaged one."""

    def __init__(self, limits: GuardLimits) -> None:
        self._limits = limits
        self._sequence = self._refused = 0
        self.refused_in_a_row = 0
        """Damaged or impossible states since the last good one."""
        self.newest: ReceivedState | None = None
        """The last good state."""

    def take(self, received: ReceivedState | None, counts: LinkCounts) -> bool:
        """Looks at what a link has; True if there is a good state that is new."""
        refused = sum(counts.refused.values())
        self.refused_in_a_row += refused - self._refused
        self._refused = refused
        if received is None or received.sequence == self._sequence:
            return False
        self._sequence = received.sequence
        if self.newest is not None:
            before = self.newest
            # two states that come in one read have one time: at least a state's usual distance lies between them
            passed_s = max(received.received_s - before.received_s, 0.0) + _USUAL_S
            if jumped(_angles(received), _angles(before), passed_s, self._limits).any():
                self.refused_in_a_row += 1
                return False
        self.newest, self.refused_in_a_row = received, 0
        return True

    def age_s(self, now_s: float) -> float:
        """Of the last good state [s]; infinite before the first."""
        return np.inf if self.newest is None else now_s - self.newest.received_s


_USUAL_S = 0.002


def _angles(received: ReceivedState) -> np.ndarray:
    return received.record["motor_state"]["q"][JOINTS]
