"""A loop at a fixed rate on any clock, and how late it was."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from hotice.deploy.clock import Clock

EDGES_MS = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 1000.0)
"""Ends of the histogram's bins."""


class Lateness:
    """How late ticks began, and how long they took: counts by `EDGES_MS`, the last bin without end."""

    def __init__(self) -> None:
        self.late = np.zeros(len(EDGES_MS) + 1, int)
        self.took = np.zeros(len(EDGES_MS) + 1, int)
        self.worst_late_s = self.worst_took_s = 0.0
        self.skipped = 0
        """Ticks that were left out, since their time was over."""

    @property
    def ticks(self) -> int:
        return int(self.late.sum())

    def add(self, late_s: float, took_s: float) -> None:
        """One tick."""
        self.late[np.searchsorted(EDGES_MS, 1e3 * late_s)] += 1
        self.took[np.searchsorted(EDGES_MS, 1e3 * took_s)] += 1
        self.worst_late_s, self.worst_took_s = max(self.worst_late_s, late_s), max(self.worst_took_s, took_s)

    def __str__(self) -> str:
        rows = [f"{self.ticks} ticks, {self.skipped} skipped; worst {1e3 * self.worst_late_s:.2f} ms late"]
        for i, edge in enumerate((*EDGES_MS, np.inf)):
            if self.late[i] or self.took[i]:
                rows.append(f"up to {edge:g} ms: {self.late[i]} late, {self.took[i]} took so long")
        return "\n".join(rows)


def run_loop(
    tick: Callable[[], object],
    clock: Clock,
    rate_hz: float,
    going: Callable[[], bool],
    lateness: Lateness | None = None,
) -> Lateness:
    """Calls `tick` at multiples of 1 / `rate_hz` [s] while `going`; what is missed is left out, never made up for."""
    seen, period_s = lateness or Lateness(), 1.0 / rate_hz
    start_s, count = clock.now(), 0
    while going():
        due_s = start_s + count * period_s
        began_s = clock.now()
        if began_s < due_s:
            clock.sleep(due_s - began_s)
            began_s = clock.now()
        tick()
        seen.add(max(began_s - due_s, 0.0), clock.now() - began_s)
        over = int((clock.now() - start_s) / period_s) - count
        seen.skipped += max(over - 1, 0)
        count += max(over, 1)
    return seen
