"""The robot's tick as an order of states: which is new, which came twice or late, how many were missed.

What one tick means is not published, so the usual step between states is learned from what comes.
"""

from __future__ import annotations

from collections import Counter
from typing import Literal

RANGE = 1 << 32
RESTART = 5
"""So many states in a row, older than the newest but each newer than the one before, are a robot that restarted."""
LONGEST_GAP = 10_000
"""Larger differences of ticks are counted as this one."""

USUAL_SHARE = 0.05
"""The usual step is the smallest with this share of all: a late reader sees larger ones more often."""

Order = Literal["new", "repeat", "backwards"]


class TickOrder:
    """Judges ticks (32 bits, which wrap) as they come."""

    def __init__(self) -> None:
        self._newest: int | None = None
        self._behind: list[int] = []
        self._steps: Counter[int] = Counter()

    def judge(self, tick: int) -> Order:
        """Whether a state with this tick is new. The fifth of a run of older ones is, and the count goes on from it."""
        if self._newest is None:
            self._newest = tick
            return "new"
        step = (tick - self._newest) % RANGE
        if step == 0:
            return "repeat"
        if step < RANGE // 2:
            self._steps[min(step, LONGEST_GAP)] += 1
            self._newest, self._behind = tick, []
            return "new"
        if self._behind and not 0 < (tick - self._behind[-1]) % RANGE < RANGE // 2:
            self._behind = []
        self._behind.append(tick)
        if len(self._behind) < RESTART:
            return "backwards"
        self._newest, self._behind = tick, []
        return "new"

    @property
    def missed(self) -> int:
        """States that should have come between those that did; 0 before two states."""
        if not self._steps:
            return 0
        rare = USUAL_SHARE * self._steps.total()
        usual = min(step for step, count in self._steps.items() if count >= rare)
        return sum(count * (round(step / usual) - 1) for step, count in self._steps.items() if step > usual)
