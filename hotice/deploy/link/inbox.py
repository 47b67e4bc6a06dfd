"""Inboxes in which messages arrive: opened, judged and counted, the newest valid one kept."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable

import numpy as np

from hotice.deploy.clock import Clock
from hotice.deploy.link.protocol import LinkCounts, ReceivedCommand, ReceivedState
from hotice.deploy.link.ticks import TickOrder
from hotice.deploy.messages.checks import open_low_cmd, open_low_state
from hotice.deploy.messages.invalid import InvalidMessage, Reason


class _Inbox:
    """Keeps the newest message that opens; `judge` decides whether it is newer than the one before."""

    def __init__(self, clock: Clock, opened: Callable[[bytes], np.ndarray]) -> None:
        self.clock, self._opened = clock, opened
        self.newest: np.ndarray | None = None
        self.taken, self.received_s = 0, 0.0
        self.refused: Counter[Reason] = Counter()

    def offer(self, data: bytes, came_s: float) -> None:
        """A message as it came, at `came_s` [s] or later; whatever is wrong with it is counted and it is dropped."""
        try:
            record = self._opened(data)
            new = self._judge(record)
        except InvalidMessage as error:
            self.refused[error.reason] += 1
            return
        if new:
            self.newest, self.received_s = record, came_s
            self.taken += 1

    @property
    def age_s(self) -> float:
        return self.clock.now() - self.received_s

    def _judge(self, record: np.ndarray) -> bool:
        raise NotImplementedError


class StateInbox(_Inbox):
    """States of one robot, in the order of its tick; the first says which machine it is, all others are refused."""

    def __init__(self, clock: Clock) -> None:
        super().__init__(clock, open_low_state)
        self._order = TickOrder()
        self._orders: Counter[str] = Counter()
        self._version_changes = 0

    def state(self) -> ReceivedState | None:
        """The newest valid state, None before the first."""
        if self.newest is None:
            return None
        return ReceivedState(record=self.newest, sequence=self.taken, received_s=self.received_s, age_s=self.age_s)

    def counts(self, foreign_commands: int) -> LinkCounts:
        return LinkCounts(
            taken=self.taken,
            repeats=self._orders["repeat"],
            backwards=self._orders["backwards"],
            missed=self._order.missed,
            refused=dict(self.refused),
            version_changes=self._version_changes,
            foreign_commands=foreign_commands,
        )

    def _judge(self, record: np.ndarray) -> bool:
        if self.newest is not None:
            machine, first = int(record["mode_machine"]), int(self.newest["mode_machine"])
            if machine != first:
                raise InvalidMessage("mode", f"LowState_ of machine {machine} came after one of machine {first}")
            self._version_changes += int((record["version"] != self.newest["version"]).any())
        order = self._order.judge(int(record["tick"]))
        self._orders[order] += 1
        return order == "new"


class CommandInbox(_Inbox):
    """Commands at the robot's end; before `machine` is known, and of another one, they are refused."""

    def __init__(self, clock: Clock) -> None:
        super().__init__(clock, open_low_cmd)
        self.machine: int | None = None

    def command(self) -> ReceivedCommand | None:
        """The newest valid command, None before the first."""
        if self.newest is None:
            return None
        return ReceivedCommand(record=self.newest, sequence=self.taken, age_s=self.age_s)

    def counts(self) -> LinkCounts:
        return LinkCounts(taken=self.taken, refused=dict(self.refused))

    def _judge(self, record: np.ndarray) -> bool:
        if int(record["mode_machine"]) != self.machine:
            raise InvalidMessage("mode", f"LowCmd_ for machine {record['mode_machine']}; this robot is {self.machine}")
        return True
