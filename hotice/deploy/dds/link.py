"""The robot's low-level topics over DDS: the controller's end, and the robot's for simulated robots."""

from __future__ import annotations

import numpy as np

from hotice.deploy.clock import Clock, MonotonicClock
from hotice.deploy.command import CheckedCommand
from hotice.deploy.dds.idl_types import packed_type
from hotice.deploy.dds.node import DdsNode
from hotice.deploy.dds.ports import Reader, Writer
from hotice.deploy.link.inbox import CommandInbox, StateInbox
from hotice.deploy.link.outgoing import outgoing
from hotice.deploy.link.protocol import LinkCounts, ReceivedCommand, ReceivedState
from hotice.deploy.messages.checks import seal
from hotice.deploy.messages.hg import LOW_CMD, LOW_STATE

COMMAND_TOPIC = "rt/lowcmd"
STATE_TOPIC = "rt/lowstate"


class Arrivals:
    """Samples of a reader, each with the earliest time that it can have come: of the take before, first of opening.

    When it truly came is not known without the sender's clock, which is not trusted. Make it before the reader opens.
    """

    def __init__(self, clock: Clock) -> None:
        self._clock, self._since_s = clock, clock.now()

    def take(self, reader: Reader) -> list[tuple[float, bytes]]:
        """(Earliest time [s], bytes), oldest first. Raises `LinkError`."""
        # read before taking: what comes in between is left for the next take
        since_s, now_s = self._since_s, self._clock.now()
        taken = reader.take()
        self._since_s = now_s
        return [(since_s, data) for data in taken]


class DdsLink:
    """A controller's end, see `Link`. It reads the command topic too: what this node did not write is foreign.

    One link on one node: commands of a second one would not count as foreign.
    """

    def __init__(self, node: DdsNode, clock: Clock | None = None) -> None:
        """Opens it. Raises `LinkError`: the node is closed, or has another link that is open."""
        node.hold_link(self)
        self._node = node
        clock = clock or MonotonicClock()
        self._inbox, self._foreign, self._arrivals = StateInbox(clock), 0, Arrivals(clock)
        self._states = Reader(node, STATE_TOPIC, packed_type(LOW_STATE))
        self._others = Reader(node, COMMAND_TOPIC, packed_type(LOW_CMD), foreign_only=True)
        self._commands = Writer(node, COMMAND_TOPIC, packed_type(LOW_CMD))

    def publish(self, command: CheckedCommand) -> None:
        self._commands.write(outgoing(command, self._inbox.state()))

    def state(self) -> ReceivedState | None:
        for came_s, data in self._arrivals.take(self._states):
            self._inbox.offer(data, came_s)
        self._foreign += len(self._others.take())
        return self._inbox.state()

    def counts(self) -> LinkCounts:
        return self._inbox.counts(self._foreign)

    def close(self) -> None:
        for port in (self._commands, self._others, self._states):
            port.close()
        self._node.free_link(self)


class DdsRobot:
    """A simulated robot's end, see `RobotEnd`."""

    def __init__(self, node: DdsNode, clock: Clock | None = None) -> None:
        clock = clock or MonotonicClock()
        self._inbox, self._arrivals = CommandInbox(clock), Arrivals(clock)
        self._commands = Reader(node, COMMAND_TOPIC, packed_type(LOW_CMD))
        self._states = Writer(node, STATE_TOPIC, packed_type(LOW_STATE))
        self._node = node
        self._disturber: Writer | None = None

    def publish_state(self, record: np.ndarray) -> None:
        self._inbox.machine = int(record["mode_machine"])
        self.send_state(seal(LOW_STATE, record))

    def send_state(self, data: bytes) -> None:
        self._states.write(data)

    def disturb(self, data: bytes) -> None:
        if self._disturber is None:
            self._disturber = Writer(self._node, COMMAND_TOPIC, packed_type(LOW_CMD))
        self._disturber.write(data)

    def command(self) -> ReceivedCommand | None:
        for came_s, data in self._arrivals.take(self._commands):
            self._inbox.offer(data, came_s)
        return self._inbox.command()

    def counts(self) -> LinkCounts:
        return self._inbox.counts()

    def close(self) -> None:
        for port in (self._disturber, self._states, self._commands):
            if port is not None:
                port.close()
