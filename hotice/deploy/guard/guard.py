"""One tick of the guard: read, judge, decide, send."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import NamedTuple, TypeVar

import numpy as np

from hotice.deploy.clock import Clock
from hotice.deploy.command import CheckedCommand, UnsafeCommand
from hotice.deploy.guard.commands import damping
from hotice.deploy.guard.config import GuardConfig
from hotice.deploy.guard.decide import decide, needs_runner
from hotice.deploy.guard.entry import against_damping, against_driving, against_posture
from hotice.deploy.guard.faults import Cause, Finding, Reaction
from hotice.deploy.guard.judge import Judge
from hotice.deploy.guard.keys import Gamepad
from hotice.deploy.guard.measured import Measured
from hotice.deploy.guard.modes import DRIVEN, Mode, Request
from hotice.deploy.guard.motion import Motion
from hotice.deploy.guard.targets import Targets
from hotice.deploy.link.protocol import Link, LinkError, ReceivedState
from hotice.deploy.messages.hg import JOINTS
from hotice.deploy.slot.records import STATUS

T = TypeVar("T")
AWAY_S = 1.0
"""A fault that was away for longer is told again [s]; one that gets worse at once."""


class Event(NamedTuple):
    """What the guard tells: a change of mode, a fault that came, or a wish that was refused."""

    time_s: float
    mode: Mode
    cause: Cause
    text: str


class Guard:
    """Call `tick` at `config.rate_hz`, for ever. The link is used by nobody else.

    Args:
        link: to the robot; `read` and `tell`: the slot (`GuardSlot.targets`, `GuardSlot.tell`)
        clock: of link and stamps
        config: times, limits, needs
        wishes: of the operator, beside the gamepad's: called once a tick
        charge: of the battery [percent], None while it is not known
        on_event: is told what happens; it must return at once
    """

    def __init__(
        self,
        link: Link,
        read: Callable[[], np.ndarray | None],
        tell: Callable[[np.ndarray], None],
        clock: Clock,
        config: GuardConfig | None = None,
        *,
        wishes: Callable[[], Iterable[Request]] = tuple,
        charge: Callable[[], float | None] = lambda: None,
        on_event: Callable[[Event], None] = lambda event: None,
    ) -> None:
        self.config = config or GuardConfig()
        self._link, self._tell, self._clock = link, tell, clock
        self._wishes, self._charge, self._on_event = wishes, charge, on_event
        self.measured = Measured(self.config.limits)
        self.targets = Targets(read, self.config.limits)
        self._judge, self._gamepad, self._motion = Judge(self.config), Gamepad(), Motion(self.config)
        self.mode, self.cause = Mode.OFF, Cause.NONE
        self._entered_s = self._others_s = clock.now()
        self._foreign, self._seen = link.counts().foreign_commands, 0
        self._told: dict[Cause, tuple[float, Reaction]] = {}
        self._refused: str = ""
        self._link_fails = False
        self._status_record = np.zeros((), STATUS)
        self._status_state = self._status_record.reshape(1).view(np.uint8)[-STATUS["state"].itemsize :]

    def tick(self) -> CheckedCommand | None:
        """Reads, decides and sends; what was sent, None in OFF and where the link cannot send."""
        now_s = self._clock.now()
        unread: list[Finding] = []
        received, counts = self._heard(self._link.state, unread), self._link.counts()
        foreign, self._foreign = counts.foreign_commands - self._foreign, counts.foreign_commands
        if foreign:
            self._others_s = now_s
        self.measured.take(received, counts)
        wishes = {*self._wishes(), *self._keys(received, now_s)}
        self.targets.take(self._motor("q") if self.mode in DRIVEN else None, now_s)
        charge = self._heard(self._charge, unread)
        found = self._judge.findings(
            self.measured,
            self.targets,
            now_s=now_s,
            charge=charge,
            gamepad_s=self._gamepad.without_s(now_s),
            foreign=foreign,
            driven=needs_runner(self.mode),
        )
        found += unread
        self._tell_faults(found, now_s)
        self._decide(found, wishes, charge, now_s)
        sent = None if self.mode is Mode.OFF else self._send(now_s)
        self._tell(self._status(now_s))
        return sent

    def _decide(self, found: list[Finding], wishes: set[Request], charge: float | None, now_s: float) -> None:
        newest, lasted_s = self.targets.newest, now_s - self._entered_s
        done = newest is not None and bool(newest["done"]) and float(newest["stamp_s"]) > self._entered_s
        against = self._against(charge, now_s) if wishes else ()
        over = lasted_s >= self.config.posture_s
        decision = decide(self.mode, found, wishes, done=done, posture_over=over, against=against)
        if decision.refused and decision.refused != self._refused:
            self._event(now_s, Cause.OPERATOR, decision.refused)
        self._refused = decision.refused
        if decision.mode is not self.mode:
            self._enter(decision.mode, decision.cause, decision.text, now_s)

    def _enter(self, mode: Mode, cause: Cause, text: str, now_s: float) -> None:
        before, self.mode, self.cause, self._entered_s = self.mode, mode, cause, now_s
        self._motion.enter(before, mode, self._motor("q"), self.targets)
        self._event(now_s, cause, text)

    def _brake(self, cause: Cause, text: str, now_s: float) -> None:
        self._tell_faults([Finding(cause, Reaction.DAMPING, "{}", text)], now_s)
        self._enter(Mode.DAMPING, cause, text, now_s)

    def _against(self, charge: float | None, now_s: float) -> tuple[str, ...]:
        if self.mode is Mode.READY:
            return tuple(against_driving(self.targets, self._motion.posture, self.config))
        if self.mode not in (Mode.OFF, Mode.DAMPING):
            return ()
        reasons = against_damping(
            self.measured,
            self.config,
            now_s=now_s,
            alone_s=now_s - self._others_s,
            charge=charge,
            gamepad=self._gamepad.there,
        )
        if self.mode is Mode.OFF:
            return tuple(reasons)
        return (*reasons, *against_posture(self.targets, self.config, now_s))

    def _send(self, now_s: float) -> CheckedCommand | None:
        newest = self.measured.newest
        machine = 0 if newest is None else newest.mode_machine
        lasted_s = now_s - self._entered_s
        try:
            command = self._motion.command(
                self.mode,
                machine,
                self._motor("q"),
                self._motor("dq"),
                self.targets,
                since_s=lasted_s,
                now_s=now_s,
            )
        except UnsafeCommand as error:
            self._brake(Cause.TARGETS_REFUSED, str(error), now_s)
            command = damping(machine)
        try:
            self._link.publish(command)
        except LinkError as error:
            if not self._link_fails:
                self._brake(Cause.LINK, str(error), now_s)
            self._link_fails = True
            return None
        self._link_fails = False
        return command

    @staticmethod
    def _heard(read: Callable[[], T | None], unread: list[Finding]) -> T | None:
        # what cannot be read has not come: the state ages, for which the motors brake, and go on braking
        try:
            return read()
        except LinkError as error:
            unread.append(Finding(Cause.LINK, Reaction.WARN, "{}", str(error)))
            return None

    def _keys(self, received: ReceivedState | None, now_s: float) -> frozenset[Request]:
        # the stop key counts in every state that opens, one that is refused for its angles too
        if received is None or received.sequence == self._seen:
            return frozenset()
        self._seen = received.sequence
        return self._gamepad.read(received.record["wireless_remote"], now_s)

    def _motor(self, name: str) -> np.ndarray:
        newest = self.measured.newest
        return np.zeros(29, np.float32) if newest is None else newest.record["motor_state"][name][JOINTS]

    def _status(self, now_s: float) -> np.ndarray:
        status = self._status_record
        status["stamp_s"], status["mode"], status["cause"] = now_s, self.mode, self.cause
        status["entered_s"] = self._entered_s
        newest = self.measured.newest
        if newest is not None and newest.sequence != status["sequence"]:
            status["sequence"], status["received_s"] = newest.sequence, newest.received_s
            # bytes: assigning a record field by field takes fifty times as long
            self._status_state[:] = np.frombuffer(newest.record.tobytes(), np.uint8)
        return status

    def _tell_faults(self, found: list[Finding], now_s: float) -> None:
        # one that comes and goes is told once, until it has been away for a while, and again where it gets worse
        for finding in found:
            told_s, worst = self._told.get(finding.cause, (-math.inf, Reaction.NONE))
            worst = worst if now_s - told_s <= AWAY_S else Reaction.NONE
            if finding.reaction > worst and self.mode is not Mode.OFF:
                self._event(now_s, finding.cause, f"{finding.reaction.name.lower()}: {finding}")
            self._told[finding.cause] = now_s, max(worst, finding.reaction)

    def _event(self, now_s: float, cause: Cause, text: str) -> None:
        self._on_event(Event(now_s, self.mode, cause, text))
