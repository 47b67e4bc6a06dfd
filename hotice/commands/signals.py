"""Signals that end a command which otherwise lives on."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def stopped_by_signals(stopped: list[int]) -> Iterator[None]:
    """Puts SIGINT and SIGTERM into a list instead of ending the program."""
    before = {
        each: signal.signal(each, lambda number, frame: stopped.append(number))
        for each in (signal.SIGINT, signal.SIGTERM)
    }
    try:
        yield
    finally:
        for each, handler in before.items():
            signal.signal(each, handler)
