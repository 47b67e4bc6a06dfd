"""Protocol of what a controller sees of a robot (`Link`), and a simulated robot of its controller (`RobotEnd`)."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from hotice.deploy.command import CheckedCommand
from hotice.deploy.messages.invalid import Reason
from hotice.errors import HoticeError


class LinkError(HoticeError):
    """A link that cannot do what is asked: closed, no robot heard yet, no such network interface."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ReceivedState:
    """The newest valid LowState, and how old it is."""

    record: np.ndarray
    """LowState () in C layout, read-only."""
    sequence: int
    """Number of states this link has taken, this one included; the same number is the same state."""
    received_s: float
    """When it came, on the link's clock [s]; over DDS, where this is not known, the earliest that it can have come."""
    age_s: float
    """Since then [s]: over DDS an upper bound, at least the time between two reads, since no sender's clock is trusted.
    A silent robot, one whose tick stands still and one that sends rubbish age alike.
    """

    @property
    def tick(self) -> int:
        return int(self.record["tick"])

    @property
    def mode_machine(self) -> int:
        return int(self.record["mode_machine"])


@dataclass(frozen=True, kw_only=True, eq=False)
class ReceivedCommand:
    """The newest valid LowCmd at the robot's end, and how old it is [s], as a state is."""

    record: np.ndarray
    sequence: int
    age_s: float


@dataclass(frozen=True, kw_only=True)
class LinkCounts:
    """Counts of what came over a link since it was opened."""

    taken: int = 0
    """Valid messages that were newer than the one before."""
    repeats: int = 0
    """Valid states with the tick of the one before: doubled, or the robot's tick stands still."""
    backwards: int = 0
    """Valid states with an older tick: out of order, or a second robot."""
    missed: int = 0
    """Ticks jumped over, in usual steps between two states; a reader that is late misses states on purpose."""
    refused: dict[Reason, int] = field(default_factory=dict)
    """Messages that did not open, by what was wrong."""
    version_changes: int = 0
    """Number of times that `version` differed from the state before: two robots on one network."""
    foreign_commands: int = 0
    """Commands that somebody else published (at least: a late reader sees the newest only)."""


class Link(Protocol):
    """The controller's end. Not to be shared by threads."""

    def publish(self, command: CheckedCommand) -> None:
        """Sends it, `mode_machine` echoed from the newest state read.

        Raises `LinkError` before `state` gave one, for a machine that is not commanded (`hg.ABSENT`), with a motor on
        that the machine lacks, and while the state's `mode_pr` is not pitch and roll.
        """
        ...

    def state(self) -> ReceivedState | None:
        """The newest valid state, taken without waiting; None before the first. Raises `LinkError` when closed."""
        ...

    def counts(self) -> LinkCounts: ...

    def close(self) -> None:
        """Sends nothing and frees everything; a second time does nothing."""
        ...


class RobotEnd(Protocol):
    """The robot's end, for simulated robots. Not to be shared by threads."""

    def publish_state(self, record: np.ndarray) -> None:
        """Sends a LowState () with its checksum set; from the first on commands for its machine are taken."""
        ...

    def send_state(self, data: bytes) -> None:
        """Sends bytes as a LowState, whatever they are: faults."""
        ...

    def disturb(self, data: bytes) -> None:
        """Publishes bytes as a LowCmd, as a second controller would: to whoever listens, this robot too."""
        ...

    def command(self) -> ReceivedCommand | None:
        """The newest valid command; one with another `mode_machine` than the last state published is dropped."""
        ...

    def counts(self) -> LinkCounts: ...

    def close(self) -> None: ...
