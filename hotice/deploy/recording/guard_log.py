"""The guard's log: states as they came, commands as they went, targets as they were taken, and every event."""

from __future__ import annotations

import json

import numpy as np

from hotice.deploy.clock import Clock
from hotice.deploy.command import CheckedCommand
from hotice.deploy.guard.guard import Event
from hotice.deploy.link.protocol import Link, LinkCounts, ReceivedState
from hotice.deploy.log.writer import LogWriter
from hotice.deploy.messages.hg import LOW_CMD, LOW_STATE
from hotice.deploy.slot.records import TARGETS
from hotice.deploy.slot.slot import GuardSlot

KINDS = {"state": LOW_STATE.dtype, "command": LOW_CMD.dtype, "targets": TARGETS, "event": None}
"""A state's time is when it came, a command's when it went; an event is JSON. Checksums of messages are not kept."""


class GuardLog:
    """Wraps a guard's link (see `Link`) and hears its events."""

    def __init__(self, link: Link, log: LogWriter, clock: Clock) -> None:
        self._link, self._log, self._clock = link, log, clock
        self._sequence = self._machine = 0

    def state(self) -> ReceivedState | None:
        received = self._link.state()
        if received is not None and received.sequence != self._sequence:
            self._sequence, self._machine = received.sequence, received.mode_machine
            self._log.write("state", received.received_s, received.record)
        return received

    def publish(self, command: CheckedCommand) -> None:
        self._link.publish(command)
        self._log.write("command", self._clock.now(), command.record(self._machine))

    def counts(self) -> LinkCounts:
        return self._link.counts()

    def close(self) -> None:
        self._link.close()

    def event(self, event: Event) -> None:
        """Logs an event."""
        said = {"mode": event.mode.name, "cause": event.cause.name, "text": event.text}
        self._log.write("event", event.time_s, json.dumps(said).encode())


class LoggedSlot:
    """Wraps the guard's end of a slot; targets are logged that are new."""

    def __init__(self, slot: GuardSlot, log: LogWriter) -> None:
        self._slot, self._log, self._number = slot, log, 0

    def targets(self) -> np.ndarray | None:
        targets = self._slot.targets()
        if targets is not None and targets["number"] != self._number:
            self._number = int(targets["number"])
            self._log.write("targets", float(targets["stamp_s"]), targets)
        return targets

    def tell(self, status: np.ndarray) -> None:
        self._slot.tell(status)
