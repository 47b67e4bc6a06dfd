"""A link inside one process: a bus between controllers and a simulated robot, on any clock, with faults on the way.

Both ends exchange the same bytes as over DDS, so that layout, checksum and every check are at work.
"""

from __future__ import annotations

import heapq
from collections.abc import Sequence

import numpy as np

from hotice.deploy.clock import Clock
from hotice.deploy.command import CheckedCommand
from hotice.deploy.link.faults import FaultInjector, Faults
from hotice.deploy.link.inbox import CommandInbox, StateInbox
from hotice.deploy.link.outgoing import outgoing
from hotice.deploy.link.protocol import LinkCounts, LinkError, ReceivedCommand, ReceivedState
from hotice.deploy.messages.checks import seal
from hotice.deploy.messages.hg import LOW_CMD, LOW_STATE


class _Way:
    """One way of the bus: what was sent, ordered by when it arrives."""

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


class MemoryBus:
    """One robot's two topics. `link()` per controller and one `robot()`; open them before anything is sent."""

    def __init__(
        self,
        clock: Clock,
        *,
        state_faults: Sequence[Faults] = (),
        command_faults: Sequence[Faults] = (),
        seed: int = 0,
    ) -> None:
        self.clock = clock
        self._state_faults = tuple(state_faults)
        self._seeds = np.random.SeedSequence(seed)
        self._commands = _Way(FaultInjector(LOW_CMD, command_faults, self._next_seed()), clock)
        self._links: list[MemoryLink] = []

    def link(self) -> MemoryLink:
        """A controller's end; a second one is a second publisher to the first."""
        way = _Way(FaultInjector(LOW_STATE, self._state_faults, self._next_seed()), self.clock)
        self._links.append(MemoryLink(self, way))
        return self._links[-1]

    def robot(self) -> MemoryRobot:
        """The robot's end."""
        return MemoryRobot(self)

    def put_state(self, data: bytes) -> None:
        """Bytes as a LowState to every controller, without faults: rubbish, or another robot."""
        for link in self._links:
            link._way.put(data)

    def put_command(self, data: bytes) -> None:
        """Bytes as a LowCmd to the robot, without faults, of nobody who has a link."""
        self._commands.put(data)
        self._count_foreign(None)

    def _send_command(self, data: bytes, sender: MemoryLink) -> None:
        self._commands.send(data)
        self._count_foreign(sender)

    def _count_foreign(self, sender: MemoryLink | None) -> None:
        for link in self._links:
            link._foreign += link is not sender

    def _next_seed(self) -> np.random.SeedSequence:
        return self._seeds.spawn(1)[0]


class MemoryLink:
    """A controller's end of a `MemoryBus`, see `Link`."""

    def __init__(self, bus: MemoryBus, way: _Way) -> None:
        self._bus, self._way, self._foreign = bus, way, 0
        self._inbox = StateInbox(bus.clock)
        self._closed = False

    def publish(self, command: CheckedCommand) -> None:
        self._open()
        self._bus._send_command(outgoing(command, self._inbox.state()), self)

    def state(self) -> ReceivedState | None:
        self._open()
        for came_s, data in self._way.take():
            self._inbox.offer(data, came_s)
        return self._inbox.state()

    def counts(self) -> LinkCounts:
        return self._inbox.counts(self._foreign)

    def close(self) -> None:
        self._closed = True

    def _open(self) -> None:
        if self._closed:
            raise LinkError("this link is closed")


class MemoryRobot:
    """The robot's end of a `MemoryBus`, see `RobotEnd`."""

    def __init__(self, bus: MemoryBus) -> None:
        self._bus, self._inbox = bus, CommandInbox(bus.clock)
        self._closed = False

    def publish_state(self, record: np.ndarray) -> None:
        self._open()
        self._inbox.machine = int(record["mode_machine"])
        data = seal(LOW_STATE, record)
        for link in self._bus._links:
            link._way.send(data)

    def command(self) -> ReceivedCommand | None:
        self._open()
        for came_s, data in self._bus._commands.take():
            self._inbox.offer(data, came_s)
        return self._inbox.command()

    def counts(self) -> LinkCounts:
        return self._inbox.counts()

    def close(self) -> None:
        self._closed = True

    def _open(self) -> None:
        if self._closed:
            raise LinkError("this robot's end is closed")
