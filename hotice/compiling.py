"""Compiling takes about a minute the first time: that it happens is said, with how far it is, and counted apart.

It is not said where the environment variable HOTICE_QUIET is set, for programs that read every line.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager

from numba.core import event

from hotice.progress import lines


class Compiling(event.Listener):
    """Time and number of functions that were compiled in this process, not found in the cache.

    Says on standard error that it happens, from the first second on, and then now and then.
    """

    FIRST_S, EVERY_S = 1.0, 10.0

    def __init__(self) -> None:
        self.functions, self.spent_s = 0, 0.0
        self._depth, self._begin, self._now = 0, 0.0, ""
        self._told, self._watching = ExitStack(), False

    def watch(self) -> None:
        """Begins to listen; once is enough."""
        if not self._watching:
            event.register("numba:compile", self)
            self._watching = True

    def on_start(self, event: event.Event) -> None:
        if self._depth == 0:
            name = getattr((event.data or {}).get("dispatcher"), "__name__", "a function")
            self._begin, self._now = time.perf_counter(), name.strip("_")
            if not os.environ.get("HOTICE_QUIET"):
                first_s = self.FIRST_S if self.spent_s < 1.0 else self.EVERY_S
                self._told.enter_context(lines(self._line, first_s, self.EVERY_S))
        self._depth += 1

    def on_end(self, event: event.Event) -> None:
        self._depth -= 1
        if self._depth == 0:
            self._told.close()
            self.spent_s += time.perf_counter() - self._begin
            self.functions += 1

    def _line(self) -> str:
        done = f"{self.functions} functions done, now {self._now}"
        return f"compiling for this machine, once, about a minute in all: {done}"


COMPILING = Compiling()
"""Of this process. numba compiles under a lock, one function and those that it calls at a time."""


@contextmanager
def apart() -> Iterator[Callable[[], float]]:
    """A function that says how long the work so far took [s], without what was compiled meanwhile."""
    begin, before = time.perf_counter(), COMPILING.spent_s
    yield lambda: time.perf_counter() - begin - (COMPILING.spent_s - before)
