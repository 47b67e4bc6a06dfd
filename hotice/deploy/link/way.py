"""One way of messages inside a process: when what was sent arrives, with faults on the way."""

from __future__ import annotations

import heapq

from hotice.deploy.clock import Clock
from hotice.deploy.link.faults import FaultInjector


class Way:
    """One way of messages: what was sent, faults applied, ordered by when it arrives."""

    def __init__(self, injector: FaultInjector, clock: Clock) -> None:
        self._injector, self._clock = injector, clock
        self._queue: list[tuple[float, int, bytes]] = []
        self._sent = 0

    def send(self, data: bytes) -> None:
        for arrives_s, arriving in self._injector.arrivals(data, self._clock.now()):
            heapq.heappush(self._queue, (arrives_s, self._sent, arriving))
            self._sent += 1

    def put(self, data: bytes) -> None:
        heapq.heappush(self._queue, (self._clock.now(), self._sent, data))
        self._sent += 1

    def take(self) -> list[tuple[float, bytes]]:
        """Arrivals since the last call, in this order: (time of arrival [s], bytes)."""
        arrived = []
        while self._queue and self._queue[0][0] <= self._clock.now():
            came_s, _, data = heapq.heappop(self._queue)
            arrived.append((came_s, data))
        return arrived
