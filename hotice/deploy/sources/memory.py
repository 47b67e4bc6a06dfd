"""A source inside one process, on any clock: what is sent arrives at once."""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic

from hotice.deploy.clock import Clock
from hotice.deploy.link.protocol import LinkError
from hotice.deploy.sources.protocol import N, Received, SourceCounts, SourceInbox


class MemorySource(Generic[N]):
    """Both ends, see `Source` and `Sender`; `decode` opens a sample, for example `PoseSample.decode`."""

    def __init__(self, clock: Clock, decode: Callable[[bytes], N]) -> None:
        self._clock, self._inbox, self._closed = clock, SourceInbox(clock, decode), False

    def send(self, data: bytes) -> None:
        if not self._closed:
            self._inbox.offer(data, self._clock.now())

    def newest(self) -> Received[N] | None:
        if self._closed:
            raise LinkError("this source is closed")
        return self._inbox.newest()

    def counts(self) -> SourceCounts:
        return self._inbox.counts()

    def close(self) -> None:
        self._closed = True
