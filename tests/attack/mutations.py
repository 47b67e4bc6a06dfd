"""Valid files, spoilt: bytes turned, moved, cut; values of documents exchanged for ones that nobody expects."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np

VALUES: tuple[Any, ...] = (
    *(None, True, False, 0, -1, 1, 0.5, -0.0, 2**31, 2**63, 2**70, 10**400, -(10**18)),
    *(1e-308, 1e308, -1e300, float("nan"), float("inf"), float("-inf")),
    *("", "x", "nan", "[/bold]", "a\0b", "../../x", "n" * 300, "\x1b[31m", "9" * 5000, "$x"),
    *([], {}, [[]], [None], [1, 2, 3], [float("nan")] * 3, {"x": 1}, [0] * 1000),
)


def of_bytes(content: bytes, rng: np.random.Generator) -> bytes:
    """Content with one fault."""
    data, n = bytearray(content), max(len(content), 1)
    at, other = int(rng.integers(n)), int(rng.integers(n))
    low, high = min(at, other), max(at, other)
    match int(rng.integers(8)):
        case 0:
            data = data[:at]
        case 1:
            data[at : at + 1] = bytes([data[at] ^ (1 << int(rng.integers(8)))])
        case 2:
            for place in rng.integers(n, size=20):
                data[place] = int(rng.integers(256))
        case 3:
            data[low:high] = b""
        case 4:
            data[low:low] = data[low : low + 100]
        case 5:
            data[low : low + 4], data[high : high + 4] = data[high : high + 4], data[low : low + 4]
        case 6:
            data[at : at + 8] = b"\xff" * 8
        case _:
            data += rng.bytes(100)
    return bytes(data)


def of_value(document: Any, rng: np.random.Generator) -> Any:
    """A document of mappings and lists with one value, key or entry changed."""
    document = copy.deepcopy(document)
    holders = list(_holders(document))
    holder = holders[int(rng.integers(len(holders)))]
    keys = list(holder) if isinstance(holder, dict) else list(range(len(holder)))
    key = keys[int(rng.integers(len(keys)))]
    value = VALUES[int(rng.integers(len(VALUES)))]
    match int(rng.integers(8)):
        case 0:
            del holder[key]
        case 1 if isinstance(holder, dict):
            holder["unknown"] = value
        case 1:
            holder.append(value)
        case 2:
            holder[key] = [holder[key]]
        case 3:
            there = keys[int(rng.integers(len(keys)))]
            holder[key], holder[there] = holder[there], holder[key]
        case _:
            holder[key] = value
    return document


def _holders(document: Any):
    """All mappings and lists of a document that hold something."""
    if isinstance(document, dict | list) and document:
        yield document
        for part in document.values() if isinstance(document, dict) else document:
            yield from _holders(part)
