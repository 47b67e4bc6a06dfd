"""Rows of numbers in untrusted files: counts are checked against the bytes that are there before memory is taken."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from hotice.errors import InvalidMap

MAX_HEADER_BYTES = 64 * 2**10
MAX_POINTS = 50_000_000


def count_of(where: str, word: str) -> int:
    """A header's count. Raises `InvalidMap` unless `word` is a plain number of at most 18 digits."""
    if not (word.isascii() and word.isdigit() and len(word) <= 18):
        raise InvalidMap(f"{where} is {word[:40]!r}: a whole number of at least 0 is needed")
    return int(word)


def check_count(points: int) -> None:
    """`InvalidMap` for more than `MAX_POINTS`."""
    if points > MAX_POINTS:
        raise InvalidMap(f"claims {points:,} points: at most {MAX_POINTS:,} are read; thin the cloud")


def text_columns(data: bytes, rows: int, width: int, columns: Sequence[int]) -> NDArray[np.float64]:
    """Three of `width` columns of `rows` lines of numbers, (rows, 3); the rest is ignored. Raises `InvalidMap`."""
    if 2 * rows * width > len(data) + 1:  # a digit and a separator each
        raise InvalidMap(f"is cut short: {rows:,} points of {width} numbers do not fit into {len(data):,} bytes")
    lines = data.decode("ascii", "replace").split("\n", rows)[:rows] if rows else []
    try:
        values = np.fromstring(" ".join(lines), sep=" ", dtype=np.float64)
    except ValueError:
        raise InvalidMap("holds text where numbers are announced") from None
    if len(values) != rows * width:
        raise InvalidMap(
            f"is cut short or uneven: {len(values):,} numbers where {rows:,} lines of {width} are announced"
        )
    return np.ascontiguousarray(values.reshape(rows, width)[:, columns])


def binary_columns(data: bytes, rows: int, dtype: np.dtype, columns: Sequence[str]) -> NDArray[np.float64]:
    """Three fields of `rows` packed records, (rows, 3); of a field with many values the first. Raises `InvalidMap`."""
    if rows * dtype.itemsize > len(data):
        raise InvalidMap(
            f"is cut short: {rows:,} points of {dtype.itemsize} bytes announced, {len(data):,} bytes there"
        )
    records = np.frombuffer(data, dtype, rows)
    firsts = (records[name][:, 0] if records[name].ndim > 1 else records[name] for name in columns)
    with np.errstate(invalid="ignore"):  # signalling NaN
        return np.stack([values.astype(np.float64) for values in firsts], axis=1)
