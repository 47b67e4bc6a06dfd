"""Real time for a simulated robot: a step every 2 ms of the machine's clock, and how late each began."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from hotice.deploy.clock import Clock
from hotice.deploy.simulated.world import STEP_S

CATCH_UP_S = 0.1
"""So much is made up for by steps without pauses; of more, time slips: the robot lives slower than the world."""
BINS_MS = np.array([0.0, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, np.inf])
"""Edges of the counts of lateness."""


class Lateness:
    """How late steps began. Attributes: counts per bin of `BINS_MS`, the worst [s], and the time that slipped [s]."""

    def __init__(self) -> None:
        self.counts = np.zeros(len(BINS_MS) - 1, dtype=np.int64)
        self.worst_s = self.slipped_s = 0.0

    def add(self, late_s: float) -> None:
        """One step."""
        self.counts[np.searchsorted(BINS_MS, 1e3 * late_s, side="right") - 1] += 1
        self.worst_s = max(self.worst_s, late_s)

    @property
    def steps(self) -> int:
        """How many steps were counted."""
        return int(self.counts.sum())

    def share_below(self, edge_ms: float) -> float:
        """Share of steps that began less than an edge of `BINS_MS` late; 1 without steps."""
        below = int(self.counts[: int(np.searchsorted(BINS_MS, edge_ms))].sum())
        return below / self.steps if self.steps else 1.0


def live(step: Callable[[], None], clock: Clock, going: Callable[[], bool]) -> Lateness:
    """Calls `step` every 2 ms while `going`; what is late is made up for, up to `CATCH_UP_S`."""
    lateness = Lateness()
    due_s = clock.now() + STEP_S
    while going():
        early_s = due_s - clock.now()
        if early_s > 0.0:
            clock.sleep(early_s)
        late_s = max(0.0, clock.now() - due_s)
        lateness.add(late_s)
        if late_s > CATCH_UP_S:
            lateness.slipped_s += late_s
            due_s += late_s
        step()
        due_s += STEP_S
    return lateness
