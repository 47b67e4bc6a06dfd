"""`hotice deploy`: starts guard and runner, shows what goes on, gives keys on, and ends both in the right order."""

from __future__ import annotations

import signal
import time
from contextlib import ExitStack

from hotice.commands.deploy.child import Child
from hotice.commands.deploy.config import DeployConfig, fitting_scene
from hotice.commands.deploy.view import View
from hotice.commands.signals import stopped_by_signals
from hotice.console import PlainConsole
from hotice.deploy.guard.modes import Mode
from hotice.deploy.programs.options import GuardOptions, RunnerOptions
from hotice.deploy.recording.place import RING_S, ring_folder
from hotice.deploy.slot.watch import SlotWatch
from hotice.deploy.terminal import Terminal
from hotice.errors import HoticeError

PERIOD_S = 0.1
GUARD_READY_S = 60.0
"""A guard imports little and listens for half a second."""
GUARD_ENDS_S = 15.0
"""It brakes for 2 s first."""
RUNNER_ENDS_S = 5.0
STOP_KEY = b"x"


class DeployFailed(HoticeError):
    """Guard or runner ended by itself; says what it said."""


def deploy(config: DeployConfig) -> None:
    """Until Ctrl-C. Raises `HoticeError`; `KeyboardInterrupt` where that came before there was a guard."""
    scene = fitting_scene(config)
    interface, domain = config.network
    console = PlainConsole()
    what = f"{config.robot} on {interface}, domain {domain}: {scene.name}{', nothing is sent' * config.dry_run}"
    signals: list[int] = []
    with ExitStack() as stack:
        stack.enter_context(stopped_by_signals(signals))
        view = stack.enter_context(View(console, what))
        view.tell(f"deploying to {what}")
        terminal = stack.enter_context(Terminal())
        keep_s = RING_S if config.log is None else None
        folder = str(ring_folder(config.slot) if config.log is None else config.log.absolute())
        view.tell(f"log: {folder}")
        guard = Child(
            "guard",
            GuardOptions(
                slot=config.slot,
                domain=domain,
                interface=interface,
                dry_run=config.dry_run,
                log=folder,
                # who sends nothing may watch while another one commands
                has_controller=config.robot == "g1" and not config.dry_run,
                release_held=config.release_held,
                keep_s=keep_s,
            ).text(),
        )
        stack.callback(_end_guard, guard, view)
        _await_guard(guard, view, signals)
        if signals:
            raise KeyboardInterrupt
        view.tell(f"guard: process {guard.pid}; it brakes until it is ended, also without this program")
        runner = Child("runner", _runner_options(config, folder, keep_s).text())
        stack.callback(runner.end, RUNNER_ENDS_S, kill=True)
        # callbacks run backwards: the guard ends first, the runner after it
        stack.callback(_end_guard, guard, view)
        watch = stack.enter_context(SlotWatch(config.slot))
        _Operation(guard, runner, view, watch, terminal, signals).live()


class _Operation:
    """The life of a deployment between its start and its end."""

    def __init__(
        self, guard: Child, runner: Child, view: View, watch: SlotWatch, terminal: Terminal, signals: list[int]
    ) -> None:
        self._guard, self._runner, self._view = guard, runner, view
        self._watch, self._terminal, self._signals = watch, terminal, signals
        self._mode = Mode.OFF
        self._lost = False

    def live(self) -> None:
        """Until it is to end. Raises `DeployFailed`."""
        while not self._told_to_end():
            for child in (self._guard, self._runner):
                for said in child.said():
                    self._view.hear(child.name, said)
            status = self._watch.status()
            self._mode = self._mode if status is None else Mode(int(status["mode"]))
            self._view.show(status, self._watch.targets(), time.monotonic())
            if typed := self._terminal.typed():
                self._guard.type(typed)
            self._look_after()
            time.sleep(PERIOD_S)
        if self._lost:
            raise DeployFailed(f"the runner ended: {self._runner.last_words}")

    def _told_to_end(self) -> bool:
        """Ctrl-C: brake, and the next one, or while it brakes already, ends; SIGTERM ends at once."""
        if signal.SIGTERM in self._signals:
            return True
        if not self._signals:
            return False
        if self._mode in (Mode.OFF, Mode.DAMPING):
            return True
        self._signals.clear()
        self._guard.type(STOP_KEY)
        self._view.tell("stopped: the motors brake; Ctrl-C again ends")
        return False

    def _look_after(self) -> None:
        if self._guard.status is not None:
            raise DeployFailed(f"the guard ended: {self._guard.last_words}: nobody commands the robot any more")
        if self._runner.status is not None and not self._lost:
            self._lost = True
            self._view.tell(f"the runner ended: {self._runner.last_words}; the motors brake; Ctrl-C ends")
            self._guard.type(STOP_KEY)
            if self._mode is Mode.OFF or not self._terminal.there:
                self._signals.append(signal.SIGTERM)


def _runner_options(config: DeployConfig, folder: str, keep_s: float | None) -> RunnerOptions:
    return RunnerOptions(
        slot=config.slot,
        scene=config.scene,
        policy=config.policy,
        box=config.box,
        pose_port=config.pose_port,
        tags_port=config.tags_port,
        movers_port=config.movers_port,
        moving=config.moving,
        pose_latency_s=config.pose_latency_s,
        tags_latency_s=config.tags_latency_s,
        log=folder,
        keep_s=keep_s,
        view_port=config.view_port if config.view else None,
    )


def _await_guard(guard: Child, view: View, signals: list[int]) -> None:
    """Until the guard listens. Raises `DeployFailed`."""
    end_s = time.monotonic() + GUARD_READY_S
    while not signals:
        for said in guard.said():
            if "ready" in said:
                return
            view.hear(guard.name, said)
        if guard.status is not None:
            guard.end(1.0, kill=True)
            raise DeployFailed(f"the guard refuses: {guard.last_words}")
        if time.monotonic() > end_s:
            raise DeployFailed(f"the guard (process {guard.pid}) was not ready within {GUARD_READY_S:g} s")
        time.sleep(0.02)


def _end_guard(guard: Child, view: View) -> None:
    """Ends it; it brakes first. One that does not end is left, and told. A second time does nothing."""
    if guard.status is not None:
        return
    view.tell("ending: the motors brake for 2 s")
    if not guard.end(GUARD_ENDS_S, kill=False):
        view.tell(f"the guard (process {guard.pid}) does not end: the robot may still be commanded")
    for said in guard.said():
        view.hear(guard.name, said)
