"""A program that `hotice deploy` starts: in a session of its own, its lines taken by a thread, its keys given on."""

from __future__ import annotations

import json
import queue
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from typing import Any

MODULES = {"guard": "hotice.deploy.programs.guard", "runner": "hotice.deploy.programs.runner"}


class Child:
    """One program; a Ctrl-C at the terminal does not reach it."""

    def __init__(self, name: str, options: str) -> None:
        self.name = name
        self._process = subprocess.Popen(
            [sys.executable, "-m", MODULES[name], options],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            start_new_session=True,
        )
        self._lines: queue.SimpleQueue[dict[str, Any]] = queue.SimpleQueue()
        self.errors: list[str] = []
        """What it wrote on its standard error."""
        self._threads = [threading.Thread(target=read, daemon=True) for read in (self._hear, self._hear_errors)]
        for thread in self._threads:
            thread.start()

    @property
    def pid(self) -> int:
        return self._process.pid

    @property
    def status(self) -> int | None:
        """Its exit status, None while it lives."""
        return self._process.poll()

    def said(self) -> Iterator[dict[str, Any]]:
        """Lines since the last call."""
        while not self._lines.empty():
            yield self._lines.get()

    def type(self, keys: bytes) -> None:
        """Gives keys on; nothing if it has gone."""
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(keys)
            self._process.stdin.flush()
        except BrokenPipeError:
            return

    def end(self, timeout_s: float, *, kill: bool) -> bool:
        """Tells it to end and waits; True if it has. `kill`: it is killed after that time."""
        if self.status is None:
            self._process.send_signal(signal.SIGTERM)
        try:
            self._process.wait(timeout_s)
        except subprocess.TimeoutExpired:
            if not kill:
                return False
            self._process.kill()
            self._process.wait()
        for thread in self._threads:
            thread.join(1.0)
        return True

    def _hear(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            try:
                said = json.loads(line)
            except ValueError:
                said = {"text": line.decode(errors="replace").rstrip()}
            self._lines.put(said if isinstance(said, dict) else {"text": str(said)})

    def _hear_errors(self) -> None:
        assert self._process.stderr is not None
        for line in self._process.stderr:
            self.errors.append(line.decode(errors="replace").rstrip())

    @property
    def last_words(self) -> str:
        """Its last line on standard error, for a message."""
        return next((line for line in reversed(self.errors) if line), "no word")
