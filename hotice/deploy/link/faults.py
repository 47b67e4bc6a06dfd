"""Faults of messages on their way, drawn at random from a seed: lost, late, doubled, damaged, frozen."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from numbers import Real

import numpy as np

from hotice import checks
from hotice.deploy.messages.cdr import decode
from hotice.deploy.messages.checks import numbers, seal
from hotice.deploy.messages.structs import Struct
from hotice.errors import InvalidConfig

CHANCES = ("lost", "late", "doubled", "bad_crc", "nan")


@dataclass(frozen=True, kw_only=True)
class Faults:
    """Chances per message, 0 to 1, while the clock is in [from_s, until_s). Raises `InvalidConfig`."""

    lost: float = 0.0
    """Never arrives."""
    late: float = 0.0
    """Arrives `late_s` later, perhaps after one that was sent later."""
    late_s: float = 0.02
    """[s]"""
    doubled: float = 0.0
    """Arrives twice."""
    bad_crc: float = 0.0
    """A bit of its checksum is flipped."""
    nan: float = 0.0
    """One of its float numbers is not a number, its checksum right."""
    frozen_tick: bool = False
    """The tick stays what it was in the first message of the time, the checksum right (states only)."""
    from_s: float = 0.0
    """[s]"""
    until_s: float = math.inf
    """[s]"""

    def __post_init__(self) -> None:
        for name in CHANCES:
            checks.number(f"faults: {name}", getattr(self, name), checks.SHARE)
        checks.number("faults: late_s", self.late_s, checks.NOT_NEGATIVE)
        checks.flag("faults: frozen_tick", self.frozen_tick)
        checks.number("faults: from_s", self.from_s)
        if not (isinstance(self.until_s, Real) and self.until_s == math.inf):
            checks.number("faults: until_s", self.until_s, checks.Range(note="or infinity"))
        if not self.from_s < self.until_s:
            raise InvalidConfig(
                f"faults: from_s is {self.from_s:g}, until_s is {self.until_s:g}: from_s below until_s is needed"
            )

    def active(self, now_s: float) -> bool:
        return self.from_s <= now_s < self.until_s


class FaultInjector:
    """Applies faults to the messages of one kind. Same seed and messages, same result; every message draws alike."""

    def __init__(self, struct: Struct, faults: Sequence[Faults], seed: np.random.SeedSequence) -> None:
        if any(f.frozen_tick for f in faults) and "tick" not in (struct.dtype.names or ()):
            raise InvalidConfig(f"faults: {struct.name} has no tick to freeze")
        self._struct, self._faults = struct, tuple(faults)
        self._rng = np.random.default_rng(seed)
        self._frozen: dict[int, int] = {}

    def arrivals(self, data: bytes, now_s: float) -> Iterator[tuple[float, bytes]]:
        """When what arrives of a message sent now: (time [s], bytes), none to many."""
        arrives_s, copies = now_s, 1
        for i, faults in enumerate(self._faults):
            draws = dict(zip(CHANCES, self._rng.random(len(CHANCES)), strict=True))
            place = int(self._rng.integers(1 << 30))
            if not faults.active(now_s):
                continue
            happens = {name: draws[name] < getattr(faults, name) for name in CHANCES}
            if faults.frozen_tick:
                data = self._with_tick_of_first(i, data)
            if happens["nan"]:
                data = self._with_nan(data, place)
            if happens["bad_crc"]:
                data = data[:-4] + bytes([data[-4] ^ 1 << place % 8]) + data[-3:]
            arrives_s += faults.late_s if happens["late"] else 0.0
            copies = 0 if happens["lost"] else copies * (2 if happens["doubled"] else 1)
        for _ in range(copies):
            yield arrives_s, data

    def _with_tick_of_first(self, i: int, data: bytes) -> bytes:
        record = decode(self._struct, data).copy()
        record["tick"] = self._frozen.setdefault(i, int(record["tick"]))
        return seal(self._struct, record)

    def _with_nan(self, data: bytes, place: int) -> bytes:
        floats = numbers(self._struct)
        raw = bytearray(decode(self._struct, data).tobytes())
        at = floats[place % len(floats)].offset
        raw[at : at + 4] = np.float32(np.nan).tobytes()
        return seal(self._struct, np.frombuffer(bytes(raw), self._struct.dtype).reshape(()))
