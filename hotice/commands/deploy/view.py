"""What the operator of a deployment sees: one table that lives, or plain lines where nobody looks at a terminal."""

from __future__ import annotations

from collections import deque
from typing import Any

import numpy as np
from rich.live import Live
from rich.table import Table

from hotice.console import PlainConsole
from hotice.deploy.guard.keyboard import KEYS as LETTERS
from hotice.deploy.guard.keys import KEYS as BUTTONS
from hotice.deploy.guard.modes import Mode, wished
from hotice.deploy.messages.remote import KEYS as PAD

SHOWN_EVENTS = 6
STOP_TEXT = "any other key, L2+B or select: stop"


def keys_on(mode: Mode) -> str:
    """Keys that lead on from a mode, letters of the keyboard and buttons of the gamepad."""
    found = []
    for letter, request in LETTERS.items():
        if wished(mode, request) is not mode:
            buttons = next("+".join(sorted(keys, key=PAD.index)) for keys, wish in BUTTONS if wish is request)
            found.append(f"{letter} {request.value} ({buttons})")
    return ", ".join([*found, *((STOP_TEXT,) if mode not in (Mode.OFF, Mode.DAMPING) else ())])


class View:
    """Takes what guard and runner say and what their slot holds. Use `with`."""

    def __init__(self, console: PlainConsole, title: str) -> None:
        self._console, self._title = console, title
        self._live = Live(console=console, auto_refresh=False) if console.is_terminal else None
        self._events: deque[str] = deque(maxlen=SHOWN_EVENTS)
        self._runner: dict[str, Any] = {}
        self._guard: dict[str, Any] = {}
        self._stage = "starting"
        self._verdicts = ""

    def __enter__(self) -> View:
        if self._live is not None:
            self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._live is not None:
            self._live.stop()

    def tell(self, text: str) -> None:
        """An event."""
        self._events.append(text)
        if self._live is None:
            self._console.print(text, soft_wrap=True)

    def hear(self, name: str, said: dict[str, Any]) -> None:
        """A line of guard or runner."""
        if "mode" in said:
            self.tell(f"{said['mode'].lower()}: {said['text']}")
        elif "stage" in said:
            self._stage = said["stage"]
            self.tell(f"runner: {said['stage']}")
        elif "warm" in said:
            self._stage = "warm"
            self.tell("runner: warm")
        elif "text" in said:
            self.tell(f"{name}: {said['text']}")
        elif "ticks" in said:
            known = self._runner if name == "runner" else self._guard
            if said.get("log") and not known.get("log"):
                self.tell(f"{name}: {said['log']}")
            known.update(said)
            if name == "runner":
                self._tell_verdicts(said)
        elif "lateness" in said:
            self.tell(f"{name}: {said['lateness'].splitlines()[0]}")

    def _tell_verdicts(self, said: dict[str, Any]) -> None:
        verdicts = f"localization: {said['pose']}; box: {said['box']}"
        verdicts += f"; movers: {said['movers']}" if "movers" in said else ""
        if self._live is None and verdicts != self._verdicts:
            self._console.print(verdicts, soft_wrap=True)
        self._verdicts = verdicts

    def show(self, status: np.ndarray | None, targets: np.ndarray | None, now_s: float) -> None:
        """The table of this moment."""
        if self._live is not None:
            self._live.update(self._table(status, targets, now_s), refresh=True)

    def _table(self, status: np.ndarray | None, targets: np.ndarray | None, now_s: float) -> Table:
        table = Table(title=self._title, show_header=False, min_width=72)
        mode = Mode.OFF if status is None else Mode(int(status["mode"]))
        table.add_row("mode", mode.name.lower() if status is None else _since(mode, status, now_s))
        table.add_row("keys", keys_on(mode) or "none: Ctrl-C ends")
        state = "none yet" if status is None or not status["sequence"] else _ms(now_s - float(status["received_s"]))
        table.add_row("state", state)
        table.add_row(
            "runner", self._stage if targets is None else f"{self._stage}, targets {_targets(targets, now_s)}"
        )
        if targets is not None:
            since_s = now_s - targets["stamp_s"]
            table.add_row("localization", f"{_age(targets['pose_age_s'] + since_s)}, {self._runner.get('pose', '')}")
            table.add_row("box", f"{_age(targets['box_age_s'] + since_s)}, {self._runner.get('box', '')}")
        if "movers" in self._runner:
            table.add_row("movers", str(self._runner["movers"]))
        goal = self._runner.get("goal_m")
        table.add_row("to the goal", "not known" if goal is None else f"{goal:.2f} m")
        table.add_row("late", f"guard {_lateness(self._guard)}; runner {_lateness(self._runner)}")
        for event in self._events:
            table.add_row("", event)
        return table


def _since(mode: Mode, status: np.ndarray, now_s: float) -> str:
    return f"{mode.name.lower()} for {now_s - float(status['entered_s']):.0f} s"


def _ms(age_s: float) -> str:
    return f"{1e3 * age_s:.0f} ms old" if age_s < 10.0 else f"{age_s:.0f} s old"


def _age(age_s: Any) -> str:
    return "never" if not np.isfinite(age_s) else f"{float(age_s):.2f} s old"


def _targets(targets: np.ndarray, now_s: float) -> str:
    return _ms(now_s - float(targets["stamp_s"])) + (", at the goal" if targets["done"] else "")


def _lateness(said: dict[str, Any]) -> str:
    if not said:
        return "not known"
    return f"{said['worst_late_ms']:.1f} ms at most, {said['skipped']} of {said['ticks']} skipped"
