"""Time of a program by label, measured without touching its code."""

from __future__ import annotations

import inspect
import time
from collections.abc import Callable
from typing import Any


class Stopwatch:
    """Sums the time spent under each label; what a labelled call spends in another one counts for the other only.

    `wait` is called at every change of label: a GPU's synchronisation, so that work is counted where it was asked for.
    """

    def __init__(self, wait: Callable[[], None] = lambda: None, clock: Callable[[], float] = time.perf_counter) -> None:
        self.seconds: dict[str, float] = {}
        self._wait, self._clock = wait, clock
        self._open: list[str] = []
        self._since = 0.0

    def timed(self, function: Callable, label: str) -> Callable:
        """The function, its time counted under `label`."""

        def wrapped(*args: Any, **kwargs: Any) -> Any:
            self._turn()
            self._open.append(label)
            try:
                return function(*args, **kwargs)
            finally:
                self._turn()
                self._open.pop()

        return wrapped

    def watch(self, owner: Any, name: str, label: str) -> None:
        """From now on the time of `owner.name(...)` counts under `label`; an attribute that is called keeps its own."""
        member = getattr(owner, name)
        timed = self.timed(member, label)
        setattr(owner, name, timed if inspect.ismethod(member) else _Called(member, timed))

    def _turn(self) -> None:
        """Books the time since the last change."""
        self._wait()
        now = self._clock()
        if self._open:
            label = self._open[-1]
            self.seconds[label] = self.seconds.get(label, 0.0) + now - self._since
        self._since = now


class _Called:
    """An object whose call is replaced and whose attributes are its own."""

    def __init__(self, wrapped: Any, call: Callable) -> None:
        self._wrapped, self._call = wrapped, call

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        return self._call(*args, **kwargs)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._wrapped, name)
