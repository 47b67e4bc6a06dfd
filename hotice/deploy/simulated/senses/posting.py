"""Rate, numbers and latency of a simulated sensor: when it measures, and when its samples are sent."""

from __future__ import annotations

from collections import deque

from hotice.deploy.sources.protocol import Sender


class Posting:
    """Samples at a rate, each sent `latency_s` after it was measured."""

    def __init__(self, sender: Sender, rate_hz: float, latency_s: float) -> None:
        self._sender, self._rate_hz, self._latency_s = sender, rate_hz, latency_s
        self._waiting: deque[tuple[float, bytes]] = deque()
        self.number = 0
        """Of the sample to be measured."""

    def due(self, time_s: float) -> bool:
        """Whether it is time to measure."""
        return time_s + 1e-9 >= self.number / self._rate_hz

    def post(self, data: bytes, time_s: float, *, lost: bool = False) -> None:
        """Takes the sample measured now; its number is used, lost or not."""
        self.number += 1
        if not lost:
            self._waiting.append((time_s + self._latency_s, data))

    def send(self, time_s: float) -> None:
        """Sends what is due. Raises `LinkError`."""
        while self._waiting and self._waiting[0][0] <= time_s + 1e-9:
            self._sender.send(self._waiting.popleft()[1])
