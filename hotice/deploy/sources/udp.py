"""Sources over UDP, one sample a datagram; on this machine alone unless another address is named."""

from __future__ import annotations

import socket
from collections.abc import Callable
from typing import Generic

from hotice.deploy.clock import Clock, MonotonicClock
from hotice.deploy.link.protocol import LinkError
from hotice.deploy.sources.protocol import N, Received, SourceCounts, SourceInbox

LOCALHOST = "127.0.0.1"
POSE_PORT, TAGS_PORT, MOVERS_PORT = 47_101, 47_102, 47_103
TAKEN_AT_ONCE = 64
LARGEST = 4096


class UdpSource(Generic[N]):
    """The reader's end, see `Source`. Whoever reaches the port can send: open it on a network that is trusted."""

    def __init__(
        self, port: int, decode: Callable[[bytes], N], *, host: str = LOCALHOST, clock: Clock | None = None
    ) -> None:
        """Listens on `port` (0: any free one) of the address `host`. Raises `LinkError`."""
        self._clock = clock or MonotonicClock()
        self._inbox = SourceInbox(self._clock, decode)
        self._since_s = self._clock.now()
        self._socket: socket.socket | None = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        try:
            self._socket.bind((host, port))
        except (OSError, OverflowError) as error:
            self._socket.close()
            raise LinkError(f"cannot listen on {host}:{port}: {error}") from None
        self.port: int = self._socket.getsockname()[1]

    def newest(self) -> Received[N] | None:
        if self._socket is None:
            raise LinkError("this source is closed")
        # read before taking: what comes in between is left for the next take
        since_s, now_s = self._since_s, self._clock.now()
        for _ in range(TAKEN_AT_ONCE):
            try:
                data = self._socket.recv(LARGEST)
            except BlockingIOError:
                self._since_s = now_s
                break
            self._inbox.offer(data, since_s)
        return self._inbox.newest()

    def counts(self) -> SourceCounts:
        return self._inbox.counts()

    def close(self) -> None:
        if self._socket is not None:
            self._socket.close()
            self._socket = None


class UdpSender:
    """Sends samples to a port, see `Sender`; that nobody listens is no error."""

    def __init__(self, port: int, *, host: str = LOCALHOST) -> None:
        """Looks the host up, once. Raises `LinkError` for one that has no IPv4 address."""
        try:
            self._to = socket.getaddrinfo(host, port, socket.AF_INET, socket.SOCK_DGRAM)[0][4]
        except (OSError, UnicodeError) as error:
            raise LinkError(f"cannot send to {host}:{port}: {error}; a name or an IPv4 address is needed") from None
        self._socket: socket.socket | None = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)

    def send(self, data: bytes) -> None:
        """Raises `LinkError` when closed, or where the network is down."""
        if self._socket is None:
            raise LinkError("this sender is closed")
        try:
            self._socket.sendto(data, self._to)
        except BlockingIOError:
            # a full buffer loses a sample, as the network may
            return
        except (OSError, OverflowError) as error:
            raise LinkError(f"cannot send to {self._to[0]}:{self._to[1]}: {error}") from None

    def close(self) -> None:
        if self._socket is not None:
            self._socket.close()
            self._socket = None
