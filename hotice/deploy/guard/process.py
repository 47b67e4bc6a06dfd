"""The guard as a process: real time, the operator's keyboard, signals; and damping as its last word."""

from __future__ import annotations

import contextlib
import gc
import signal
from collections.abc import Callable, Iterable
from types import FrameType
from typing import Protocol

import numpy as np

from hotice.deploy.clock import Clock
from hotice.deploy.guard.commands import damping
from hotice.deploy.guard.config import GuardConfig
from hotice.deploy.guard.faults import Cause
from hotice.deploy.guard.guard import Event, Guard
from hotice.deploy.guard.loop import Lateness, run_loop
from hotice.deploy.guard.modes import Mode, Request
from hotice.deploy.guard.scheduling import give_way, take_precedence
from hotice.deploy.link.protocol import Link, LinkError

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
LEAVE_S = 2.0
"""How long motors have been braking before a guard that was told to end does [s]: a fall is over by then."""


class SlotEnd(Protocol):
    """The guard's end of a slot, see `GuardSlot`."""

    def targets(self) -> np.ndarray | None: ...

    def tell(self, status: np.ndarray) -> None: ...


class Ending:
    """Signals as the operator's stop: the first stops, and the guard ends `LEAVE_S` later."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self.since_s: float | None = None

    def __call__(self, number: int, frame: FrameType | None) -> None:
        if self.since_s is None:
            self.since_s = self._clock.now()

    def over(self, mode: Mode) -> bool:
        """Whether the guard may end."""
        return self.since_s is not None and (mode is Mode.OFF or self._clock.now() - self.since_s > LEAVE_S)


def run_guard(
    link: Link,
    slot: SlotEnd,
    clock: Clock,
    config: GuardConfig | None = None,
    *,
    wishes: Callable[[], Iterable[Request]] = tuple,
    charge: Callable[[], float | None] = lambda: None,
    on_event: Callable[[Event], None] = lambda event: None,
    lateness: Lateness | None = None,
) -> Lateness:
    """Guards until a signal (`SIGNALS`) ends it; closes neither link nor slot. For the main thread of a process.

    Whatever ends it, an error too, the last commands are damping for `LEAVE_S`.
    """
    ending = Ending(clock)

    def all_wishes() -> set[Request]:
        return {*wishes(), *((Request.STOP,) if ending.since_s is not None else ())}

    guard = Guard(link, slot.targets, slot.tell, clock, config, wishes=all_wishes, charge=charge, on_event=on_event)
    before = {number: signal.signal(number, ending) for number in SIGNALS}
    # what was made until now is never looked at again: no pauses of the collector over a large heap
    gc.collect()
    gc.freeze()
    first = take_precedence()
    if not first:
        on_event(
            Event(clock.now(), Mode.OFF, Cause.NONE, "not allowed to run before other processes: ticks may be late")
        )
    ended_well = False
    try:
        seen = run_loop(guard.tick, clock, guard.config.rate_hz, lambda: not ending.over(guard.mode), lateness)
        ended_well = True
        return seen
    finally:
        if not ended_well and guard.mode is not Mode.OFF:
            newest = guard.measured.newest
            last_words(link, 0 if newest is None else newest.mode_machine, clock, guard.config.rate_hz)
        for number, handler in before.items():
            signal.signal(number, handler)
        if first:
            give_way()
        gc.unfreeze()


def last_words(link: Link, machine: int, clock: Clock, rate_hz: float) -> None:
    """Damping for `LEAVE_S`, whatever state guard and link are in: reads nothing, goes on after one that fails."""
    command, end_s = damping(machine), clock.now() + LEAVE_S
    while clock.now() < end_s:
        with contextlib.suppress(LinkError):
            link.publish(command)
        clock.sleep(1.0 / rate_hz)
