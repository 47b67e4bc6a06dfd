"""Other publishers of commands: two commanders make a robot shake or fall."""

from __future__ import annotations

from hotice.deploy.clock import Clock
from hotice.deploy.link.protocol import Link, LinkError

LISTEN_S = 0.5


class SecondPublisher(LinkError):
    """Somebody else publishes commands to the same robot."""


def check_sole_publisher(link: Link, clock: Clock, *, listen_s: float = LISTEN_S) -> None:
    """Listens for commands that are not ours, `listen_s` [s]. Raises `SecondPublisher`.

    A controller that is silent now and speaks later is not noticed here: watch `LinkCounts.foreign_commands`.
    """
    link.state()
    before = link.counts().foreign_commands
    clock.sleep(listen_s)
    link.state()
    heard = link.counts().foreign_commands - before
    if heard:
        raise SecondPublisher(
            f"somebody else sent at least {heard} commands in {listen_s:g} s: release the robot's own controller "
            f"(leave_high_level), stop other programs, then try again"
        )
