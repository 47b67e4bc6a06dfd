"""Keys of the gamepad as wishes of the operator: stop while held, everything else once when pressed."""

from __future__ import annotations

import numpy as np

from hotice.deploy.guard.modes import Request
from hotice.deploy.messages import remote

KEYS: tuple[tuple[frozenset[str], Request], ...] = (
    (frozenset({"L2", "B"}), Request.STOP),
    (frozenset({"select"}), Request.STOP),
    (frozenset({"start"}), Request.START),
    (frozenset({"L2", "up"}), Request.POSTURE),
    (frozenset({"R1", "A"}), Request.PICK_UP),
    (frozenset({"R1", "X"}), Request.CARRY),
    (frozenset({"R1", "Y"}), Request.HOLD),
    (frozenset({"R1", "down"}), Request.LOWER),
)
"""Which keys, held together, are which wish; L2+B stops as in other public programs."""


class Gamepad:
    """Reads `wireless_remote` of state after state."""

    def __init__(self) -> None:
        self._held: frozenset[Request] | None = None
        self._seen_s: float | None = None
        self.there = False
        """Whether there was a gamepad in the newest state."""

    def read(self, bytes_: np.ndarray, now_s: float) -> frozenset[Request]:
        """Wishes in the 40 bytes of a state that is new at `now_s` [s]."""
        self.there = remote.connected(bytes_)
        if self.there or self._seen_s is None:
            self._seen_s = now_s
        keys = remote.pressed(bytes_)
        held = frozenset(wish for combination, wish in KEYS if combination <= keys)
        # what is held down at the start was pressed for somebody else
        fresh = frozenset() if self._held is None else held - self._held
        self._held = held
        return fresh | (held & {Request.STOP})

    def without_s(self, now_s: float) -> float:
        """Time since there was a gamepad, or since the first state [s]."""
        return 0.0 if self._seen_s is None else now_s - self._seen_s
