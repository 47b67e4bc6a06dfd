"""A link that does all but send: every command is made and checked as if it were."""

from __future__ import annotations

from hotice.deploy.command import CheckedCommand
from hotice.deploy.link.outgoing import outgoing
from hotice.deploy.link.protocol import Link, LinkCounts, ReceivedState


class DryLink:
    """Wraps a link; see `Link`."""

    def __init__(self, link: Link) -> None:
        self._link = link
        self.commands = 0
        """Commands that would have been sent."""
        self.last: CheckedCommand | None = None
        """The last of them."""

    def publish(self, command: CheckedCommand) -> None:
        outgoing(command, self._link.state())
        self.commands, self.last = self.commands + 1, command

    def state(self) -> ReceivedState | None:
        return self._link.state()

    def counts(self) -> LinkCounts:
        return self._link.counts()

    def close(self) -> None:
        self._link.close()
