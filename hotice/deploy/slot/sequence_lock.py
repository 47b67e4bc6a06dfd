"""A record in shared memory with one writer and any readers, none of which ever waits for another.

The writer makes the counter odd, writes, and makes it even; a reader that sees it odd or changed has a torn record and
takes none. A checksum over counter and record finds what a processor that reorders writes leaves torn, and a writer
that died in the middle.
"""

from __future__ import annotations

import mmap
import zlib

import numpy as np

from hotice.deploy.slot.records import Channel

_COUNTER, _CHECKSUM, _RECORD = 0, 8, 16


class SequenceLocked:
    """One channel of a mapped slot."""

    def __init__(self, memory: mmap.mmap, channel: Channel) -> None:
        self._dtype = channel.dtype
        self._bytes = memoryview(memory)[channel.offset : channel.offset + _RECORD + channel.dtype.itemsize]
        self.torn = 0
        """Reads that found a torn record."""

    def write(self, record: np.ndarray) -> None:
        """Makes the record () the newest."""
        data = record.tobytes()
        # a writer that died in the middle left it odd
        odd = (self._counter() | 1) & _MASK
        self._put(_COUNTER, odd)
        even = (odd + 1) & _MASK
        self._bytes[_RECORD:] = data
        self._put(_CHECKSUM, _checksum(even, data))
        self._put(_COUNTER, even)

    def read(self) -> np.ndarray | None:
        """A copy of the newest record (), read-only; None before the first and when it is torn."""
        before = self._counter()
        data, checksum = bytes(self._bytes[_RECORD:]), self._get(_CHECKSUM)
        after = self._counter()
        if after == 0:
            return None
        if before & 1 or before != after or checksum != _checksum(after, data):
            self.torn += 1
            return None
        return np.frombuffer(data, self._dtype).reshape(())

    def release(self) -> None:
        """Lets go of the memory, so that it can be unmapped."""
        self._bytes.release()

    def _counter(self) -> int:
        return self._get(_COUNTER)

    def _get(self, place: int) -> int:
        return int.from_bytes(self._bytes[place : place + 8], "little")

    def _put(self, place: int, value: int) -> None:
        self._bytes[place : place + 8] = value.to_bytes(8, "little")


_MASK = (1 << 64) - 1


def _checksum(counter: int, data: bytes) -> int:
    return zlib.crc32(data, zlib.crc32(counter.to_bytes(8, "little")))
