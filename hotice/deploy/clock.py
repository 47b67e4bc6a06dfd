"""Time that only runs forward: the machine's, or a simulated one that tests turn by hand."""

from __future__ import annotations

import time
from typing import Protocol

from hotice.errors import InvalidConfig


class Clock(Protocol):
    """Seconds since some start, never set back."""

    def now(self) -> float: ...

    def sleep(self, seconds: float) -> None: ...


class MonotonicClock:
    """The machine's clock, which no correction of the date sets back."""

    def now(self) -> float:
        return time.monotonic()

    def sleep(self, seconds: float) -> None:
        time.sleep(seconds)


class SimulatedClock:
    """Stands still until somebody sleeps."""

    def __init__(self, start_s: float = 0.0) -> None:
        self._now = start_s

    def now(self) -> float:
        return self._now

    def sleep(self, seconds: float) -> None:
        if not seconds >= 0.0:
            raise InvalidConfig(f"a clock cannot sleep {seconds} s: 0 or more is needed")
        self._now += seconds
