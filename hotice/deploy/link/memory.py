"""A link inside one process: a bus between controllers and a simulated robot, on any clock, with faults on the way.

Both ends exchange the same bytes as over DDS, so that layout, checksum and every check are at work.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hotice.deploy.clock import Clock
from hotice.deploy.command import CheckedCommand
from hotice.deploy.link.faults import FaultInjector, Faults
from hotice.deploy.link.inbox import CommandInbox, StateInbox
from hotice.deploy.link.outgoing import outgoing
from hotice.deploy.link.protocol import LinkCounts, LinkError, ReceivedCommand, ReceivedState
from hotice.deploy.link.way import Way
from hotice.deploy.messages.checks import seal
from hotice.deploy.messages.hg import LOW_CMD, LOW_STATE


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
        self._commands = Way(FaultInjector(LOW_CMD, command_faults, self._next_seed()), clock)
        self._links: list[MemoryLink] = []

    def link(self) -> MemoryLink:
        """A controller's end; a second one is a second publisher to the first."""
        way = Way(FaultInjector(LOW_STATE, self._state_faults, self._next_seed()), self.clock)
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

    def __init__(self, bus: MemoryBus, way: Way) -> None:
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
        self._inbox.machine = int(record["mode_machine"])
        self.send_state(seal(LOW_STATE, record))

    def send_state(self, data: bytes) -> None:
        self._open()
        for link in self._bus._links:
            link._way.send(data)

    def command(self) -> ReceivedCommand | None:
        self._open()
        for came_s, data in self._bus._commands.take():
            self._inbox.offer(data, came_s)
        return self._inbox.command()

    def disturb(self, data: bytes) -> None:
        self._open()
        self._bus.put_command(data)

    def counts(self) -> LinkCounts:
        return self._inbox.counts()

    def close(self) -> None:
        self._closed = True

    def _open(self) -> None:
        if self._closed:
            raise LinkError("this robot's end is closed")
