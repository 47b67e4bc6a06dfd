"""Samples of what is too much for every run of the tests: each run takes others, by a seed that its header tells.

`HOTICE_SAMPLE_SEED=N` takes those of another run again.
"""

from __future__ import annotations

import os
import random
import time
from collections.abc import Callable, Iterable
from typing import TypeVar

SEED_NAME = "HOTICE_SAMPLE_SEED"
T = TypeVar("T")


def draw_seed() -> int:
    """The seed of this run; the first process of a run draws it, those that it starts find it in their environment."""
    return int(os.environ.setdefault(SEED_NAME, str(time.time_ns() % 100_000)))


def sample(items: Iterable[T], most: int) -> list[T]:
    """So many of the items, or all, in an order that is the seed's."""
    items = list(items)
    return random.Random(draw_seed()).sample(items, min(most, len(items)))


def split_alone(items: list[T], is_alone: Callable[[T], bool], asked: bool, beside: bool) -> tuple[list[T], list[T]]:
    """Tests that run, and those left out: of tests that need the machine for themselves where others run beside them,
    of the others where those alone are asked for."""
    run = [item for item in items if is_alone(item) or not asked]
    if beside and not asked:
        run = [item for item in run if not is_alone(item)]
    runs = {id(item) for item in run}
    return run, [item for item in items if id(item) not in runs]
