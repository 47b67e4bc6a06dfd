"""The guard as a program: `python -m hotice.deploy.programs.guard OPTIONS`; keys come on standard input.

It outlives the program that started it: when that one is gone the motors brake, and go on braking until a signal.
"""

from __future__ import annotations

import contextlib
import signal
import sys
from collections.abc import Iterable

from hotice.deploy.clock import MonotonicClock
from hotice.deploy.dds.battery import DdsBattery
from hotice.deploy.dds.link import DdsLink
from hotice.deploy.dds.node import DdsNode
from hotice.deploy.dds.service import DdsService
from hotice.deploy.guard.dry import DryLink
from hotice.deploy.guard.guard import Event
from hotice.deploy.guard.keyboard import Keyboard
from hotice.deploy.guard.loop import Lateness
from hotice.deploy.guard.modes import Mode, Request
from hotice.deploy.guard.process import run_guard
from hotice.deploy.guard.scheduling import MAY_WAIT_FOR_DISK, PRIORITY, stay_in_memory, take_precedence
from hotice.deploy.link.publishers import check_sole_publisher
from hotice.deploy.log.writer import LogWriter
from hotice.deploy.programs.logging import open_log, report
from hotice.deploy.programs.options import GuardOptions
from hotice.deploy.programs.saying import Saying, ended
from hotice.deploy.recording.guard_log import KINDS, GuardLog, LoggedSlot
from hotice.deploy.slot.slot import GuardSlot
from hotice.deploy.switcher import SERVICE, made_ours

GUARD_LOG = "guard"
"""Name of its log."""
TOLD_TICKS = 500
"""Ticks from one report of lateness to the next."""


class Operator:
    """Wishes from the pipe of the program that started the guard; when that is gone, stop."""

    def __init__(self, keyboard: Keyboard, say: Saying, lateness: Lateness, log: LogWriter) -> None:
        self._keyboard, self._say, self._lateness, self._log = keyboard, say, lateness, log
        self._count, self._mode = 0, Mode.OFF

    def __call__(self) -> Iterable[Request]:
        """Once a tick."""
        self._count += 1
        if self._count % TOLD_TICKS == 0:
            self._say(**report(self._lateness, self._log))
        wishes = self._keyboard()
        if not self._keyboard.ended:
            return wishes
        if self._mode is Mode.OFF:
            # nothing was sent since, and nobody is left to ask for anything
            signal.raise_signal(signal.SIGTERM)
        return (Request.STOP,)

    def hear(self, event: Event) -> None:
        """An event of the guard."""
        self._mode = event.mode
        self._say(mode=event.mode.name, cause=event.cause.name, text=event.text, time_s=event.time_s)


def main(options: GuardOptions) -> None:
    """Guards until a signal. Raises `HoticeError`."""
    clock, say, lateness = MonotonicClock(), Saying(), Lateness()
    # threads have the precedence of who made them: those that receive states, too, must not wait for other programs
    take_precedence()
    with contextlib.ExitStack() as stack:
        slot = GuardSlot(options.slot)
        stack.callback(slot.close)
        node = stack.enter_context(DdsNode(domain=options.domain, interface=options.interface))
        dds = DdsLink(node, clock)
        stack.callback(dds.close)
        battery = DdsBattery(node)
        stack.callback(battery.close)
        if options.has_controller:
            service = DdsService(node, SERVICE, clock)
            stack.callback(service.close)
            say(text=made_ours(service, clock, robot_is_held=options.release_held))
        check_sole_publisher(dds, clock)
        log = stack.enter_context(open_log(options, GUARD_LOG, KINDS, PRIORITY))
        link = GuardLog(DryLink(dds) if options.dry_run else dds, log, clock)
        operator = Operator(stack.enter_context(Keyboard()), say, lateness, log)

        def hear(event: Event) -> None:
            operator.hear(event)
            link.event(event)

        if not stay_in_memory():
            say(text=MAY_WAIT_FOR_DISK)
        say(ready=True)
        run_guard(
            link,
            LoggedSlot(slot, log),
            clock,
            wishes=operator,
            charge=battery.charge,
            on_event=hear,
            lateness=lateness,
        )
        say(lateness=str(lateness))


if __name__ == "__main__":
    sys.exit(ended(lambda: main(GuardOptions.of(sys.argv[1]))))
