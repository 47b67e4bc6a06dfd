"""Gamepad in the hands of whoever runs a simulated robot: keys pressed for a time, sticks, in or out of reach."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from hotice import checks
from hotice.deploy.messages.remote import AT_REST, KEYS, Sticks, encode_remote
from hotice.deploy.simulated.timed import timed
from hotice.errors import UnknownName

HEAD = (0x55, 0x51)
"""First two bytes of a gamepad that is there (unitree_sdk2, `gamepad.hpp`): all 40 zero is none."""
PRESS_S = 0.2


@dataclass(frozen=True, kw_only=True)
class Press:
    """Keys of the gamepad held down from `from_s` for `for_s` [s]."""

    keys: tuple[str, ...]
    from_s: float
    for_s: float = PRESS_S

    @classmethod
    def parse(cls, text: str) -> Press:
        """From `KEYS@STARTs` or `KEYS@STARTs+DURATIONs`, keys joined by +. Raises `UnknownName`, `InvalidConfig`."""
        what, from_s, for_s = timed("press", text, "start@1s or L2+B@4s+0.5s")
        keys = tuple(what.split("+"))
        for key in keys:
            if key not in KEYS:
                raise UnknownName("key of the gamepad", key, KEYS)
        return cls(keys=keys, from_s=from_s, for_s=PRESS_S if for_s is None else for_s)


class SimulatedRemote:
    """What the gamepad does; time is that of the robot [s]."""

    def __init__(self) -> None:
        self._until: dict[str, float] = {}
        self.sticks: Sticks = AT_REST
        self.lost = False
        """Whether it is out of reach: all bytes are zero."""

    def press(self, keys: Iterable[str], now_s: float, *, for_s: float = PRESS_S) -> None:
        """Holds keys of `remote.KEYS` down until `now_s` + `for_s`. Raises `UnknownName`."""
        for_s = checks.number("for_s", for_s, checks.POSITIVE)
        for key in keys:
            if key not in KEYS:
                raise UnknownName("key of the gamepad", key, KEYS)
            self._until[key] = max(self._until.get(key, now_s), now_s + for_s)

    def pressed(self, now_s: float) -> frozenset[str]:
        """Keys that are down."""
        return frozenset(key for key, until_s in self._until.items() if now_s < until_s)

    def bytes(self, now_s: float) -> np.ndarray:
        """The 40 bytes of a state, (40,) uint8."""
        if self.lost:
            return np.zeros_like(encode_remote())
        # encoded anew: what a state holds must not change with the next
        encoded = encode_remote(self.pressed(now_s), self.sticks).copy()
        encoded[:2] = HEAD
        return encoded
