"""A record in shared memory with one writer and any readers, none of which ever waits for another.

There is room for two records. The writer fills the one that is not the newest and then counts up, so that a reader
finds a whole record at any time, also beside a writer that is writing, or died in the middle: who reads every 20 ms
what is written every 2 ms must not find nothing, three times in a row, because both keep time well. A checksum over
counter and record finds what two writes during one read, or a processor that reorders them, leave torn.
"""

from __future__ import annotations

import mmap
import zlib

import numpy as np

from hotice.deploy.slot.records import CHECKSUM, COUNTER, Channel

TRIES = 4
"""Looks before a record counts as torn; each but the first follows a writer that was quicker."""


class DoubleBuffer:
    """One channel of a mapped slot."""

    def __init__(self, memory: mmap.mmap, channel: Channel) -> None:
        self._dtype = channel.dtype
        self._bytes = memoryview(memory)[channel.offset : channel.offset + channel.size]
        self.torn = 0
        """Reads that found no whole record."""

    def write(self, record: np.ndarray) -> None:
        """Makes the record () the newest."""
        data, count = record.tobytes(), (self._counter() + 1) & _MASK or 2
        begin = self._place(count)
        self._bytes[begin + CHECKSUM : begin + CHECKSUM + len(data)] = data
        self._put(begin, _checksum(count, data))
        self._put(0, count)

    def read(self) -> np.ndarray | None:
        """A copy of the newest record (), read-only; None before the first and when it is torn."""
        for _ in range(TRIES):
            count = self._counter()
            if count == 0:
                return None
            begin = self._place(count)
            checksum = self._get(begin)
            data = bytes(self._bytes[begin + CHECKSUM : begin + CHECKSUM + self._dtype.itemsize])
            if checksum == _checksum(count, data):
                return np.frombuffer(data, self._dtype).reshape(())
        self.torn += 1
        return None

    def release(self) -> None:
        """Lets go of the memory, so that it can be unmapped."""
        self._bytes.release()

    def _place(self, count: int) -> int:
        """Where record number `count` begins, with its checksum."""
        return COUNTER + (count & 1) * (CHECKSUM + self._dtype.itemsize)

    def _counter(self) -> int:
        return self._get(0)

    def _get(self, place: int) -> int:
        return int.from_bytes(self._bytes[place : place + 8], "little")

    def _put(self, place: int, value: int) -> None:
        self._bytes[place : place + 8] = value.to_bytes(8, "little")


_MASK = (1 << 64) - 1


def _checksum(counter: int, data: bytes) -> int:
    return zlib.crc32(data, zlib.crc32(counter.to_bytes(8, "little")))
