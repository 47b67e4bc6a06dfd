"""How far long work is: a bar or a spinner on a terminal, a line now and then where standard error is a file or pipe.

Quick work says nothing in a file, so that an error's line stands alone.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from typing import TypeVar

Item = TypeVar("Item")
EVERY_S = 30.0
"""Time until the first line, and between lines."""


@contextlib.contextmanager
def counting(what: str, total: int, done: int = 0) -> Iterator[Callable[[int], None]]:
    """A function that is to be told how many of `total` things are done by now; `done`: how many were before."""
    import rich.progress as bars

    from hotice.console import PlainConsole

    console = PlainConsole(stderr=True)
    if console.is_terminal:
        times = (bars.TimeElapsedColumn(), bars.TimeRemainingColumn())
        columns = (bars.TextColumn("{task.description}"), bars.BarColumn(), bars.MofNCompleteColumn(), *times)
        with bars.Progress(*columns, console=console, transient=True) as bar:
            task = bar.add_task(what, total=total, completed=done)
            yield lambda n: bar.update(task, completed=n)
        return
    now, begin = [done], time.monotonic()
    with lines(lambda: f"{what}: {now[0]:,} of {total:,}{left(now[0] - done, total - now[0], begin)}"):
        yield lambda n: now.__setitem__(0, n)


def left(made: float, to_make: float, begin: float) -> str:
    """Time left in words (`, some 4 min left`) at the rate since `begin` (`time.monotonic`); empty: no rate yet."""
    if made <= 0 or to_make <= 0:
        return ""
    return f", some {in_words(to_make * (time.monotonic() - begin) / made)} left"


def in_words(seconds: float) -> str:
    """A duration as one rough number: 40 s, 12 min, 3.5 h."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 90 * 60 else f"{seconds / 3600:.1f} h"


def counted(items: Iterable[Item], what: str, total: int) -> Iterator[Item]:
    """The `total` items, each of which is done when the next one is asked for."""
    with counting(what, total) as told:
        for number, item in enumerate(items, 1):
            yield item
            told(number)


@contextlib.contextmanager
def doing(what: str) -> Iterator[Callable[[str], None]]:
    """A function that may be told what is being done by now."""
    from rich.text import Text

    from hotice.console import PlainConsole

    console = PlainConsole(stderr=True)
    if console.is_terminal:
        with console.status(what) as status:
            yield lambda text: status.update(Text(text))
        return
    now = [what]
    with lines(lambda: now[0]):
        yield lambda text: now.__setitem__(0, text)


@contextlib.contextmanager
def lines(text: Callable[[], str], first_s: float | None = None, every_s: float | None = None) -> Iterator[None]:
    """Prints `text()` and the time so far on standard error now and then, from a thread of its own.

    `first_s`, `every_s`: time until the first line and between lines, `EVERY_S` each where not given.
    """
    from hotice.console import PlainConsole

    console, begin, over = PlainConsole(stderr=True), time.monotonic(), threading.Event()

    def talk() -> None:
        wait_s = EVERY_S if first_s is None else first_s
        while not over.wait(wait_s):
            wait_s = EVERY_S if every_s is None else every_s
            console.print(f"{text()}, {time.monotonic() - begin:.0f} s", soft_wrap=True)

    thread = threading.Thread(target=talk, daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()
