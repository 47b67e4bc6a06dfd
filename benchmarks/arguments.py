"""Types of arguments of the benchmarks: a wrong number is refused by `argparse`, in one line and with status 2."""

from __future__ import annotations

import argparse

from hotice.checks import COUNT, INT64, POSITIVE, Range, number, whole
from hotice.errors import InvalidConfig


def a_count(text: str) -> int:
    """A number of things of which there must be one."""
    return _whole(text, COUNT)


def a_seed(text: str) -> int:
    """A seed, from 0."""
    return _whole(text, INT64)


def from_zero(text: str) -> int:
    """A number of things of which there may be none, or the number of a thing counted from 0."""
    return _whole(text, Range(least=0))


def a_time(text: str) -> float:
    """A duration that is longer than none."""
    try:
        return number("a time", float(text), POSITIVE)
    except (ValueError, InvalidConfig):
        raise argparse.ArgumentTypeError(f"{text!r}: a number above 0 is needed") from None


def _whole(text: str, allowed: Range) -> int:
    try:
        return whole("a number", int(text), allowed)
    except (ValueError, InvalidConfig):
        raise argparse.ArgumentTypeError(f"{text!r}: a whole number {allowed} is needed") from None
