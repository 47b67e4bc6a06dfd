"""The gamepad inside `LowState.wireless_remote` (40 bytes): keys, sticks and whether there is one.

Layout: unitree_sdk2, `gamepad.hpp`. Keys and sticks are read apart, so that a broken stick never hides the stop key.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from hotice.deploy.messages.invalid import InvalidMessage
from hotice.errors import UnknownName

KEYS = ("R1", "L1", "start", "select", "R2", "L2", "F1", "F2", "A", "B", "X", "Y", "up", "right", "down", "left")
"""By bit of bytes 2 and 3, from bit 0."""
SIZE = 40
DTYPE = np.dtype(
    {
        "names": ["keys", "lx", "rx", "ry", "l2", "ly"],
        "formats": ["<u2", "<f4", "<f4", "<f4", "<f4", "<f4"],
        "offsets": [2, 4, 8, 12, 16, 20],
        "itemsize": SIZE,
    }
)


class Sticks(NamedTuple):
    """Sticks, −1 to 1, right and up positive, and the analogue trigger L2."""

    lx: float = 0.0
    ly: float = 0.0
    rx: float = 0.0
    ry: float = 0.0
    l2: float = 0.0


AT_REST = Sticks()


def connected(remote: np.ndarray) -> bool:
    """Whether any of the 40 bytes differs from zero; with no gamepad for a while none does."""
    return bool(np.any(remote))


def pressed(remote: np.ndarray) -> frozenset[str]:
    """Keys held down, by name; never raises for 40 bytes whatever they hold."""
    keys = int(_view(remote)["keys"])
    return frozenset(key for bit, key in enumerate(KEYS) if keys >> bit & 1)


def sticks(remote: np.ndarray) -> Sticks:
    """Positions of the sticks. Raises `InvalidMessage` if one is not a number from −1 to 1."""
    view = _view(remote)
    values = Sticks(*(float(view[name]) for name in Sticks._fields))
    for name, value in zip(Sticks._fields, values, strict=True):
        if not abs(value) <= 1.0 + 1e-3:
            raise InvalidMessage("number", f"gamepad: {name} is {value:g}: −1 to 1 is possible")
    return values


def encode_remote(keys: Iterable[str] = (), values: Sticks = AT_REST) -> np.ndarray:
    """The 40 bytes (40,) uint8 for keys held down and sticks, as a simulated robot sends them. Raises `UnknownName`."""
    record = np.zeros((), DTYPE)
    for key in keys:
        if key not in KEYS:
            raise UnknownName("key of the gamepad", key, KEYS)
        record["keys"] |= 1 << KEYS.index(key)
    for name in Sticks._fields:
        record[name] = getattr(values, name)
    return np.frombuffer(record.tobytes(), np.uint8)


def _view(remote: np.ndarray) -> np.ndarray:
    return np.frombuffer(np.asarray(remote, np.uint8).tobytes(), DTYPE).reshape(())
