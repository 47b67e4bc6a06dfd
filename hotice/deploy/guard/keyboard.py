"""The keyboard as the operator's wishes: known keys ask, every other key stops."""

from __future__ import annotations

import os
import select
import sys
import termios
import tty
from collections.abc import Iterable

from hotice.deploy.guard.modes import Request

KEYS = {
    "s": Request.START,
    "p": Request.POSTURE,
    "u": Request.PICK_UP,
    "c": Request.CARRY,
    "h": Request.HOLD,
    "l": Request.LOWER,
}


class Keyboard:
    """Keys of a terminal, each as it is pressed; of a pipe, each character but line ends. Use `with`."""

    def __init__(self, descriptor: int | None = None) -> None:
        self._descriptor = sys.stdin.fileno() if descriptor is None else descriptor
        self._before: list | None = None
        self.ended = False
        """Whether a pipe's other end is closed: nobody is there any more."""

    def __enter__(self) -> Keyboard:
        if os.isatty(self._descriptor):
            self._before = termios.tcgetattr(self._descriptor)
            tty.setcbreak(self._descriptor)
        return self

    def __exit__(self, *_: object) -> None:
        if self._before is not None:
            termios.tcsetattr(self._descriptor, termios.TCSADRAIN, self._before)

    def __call__(self) -> Iterable[Request]:
        """Wishes since the last call, without waiting."""
        if self.ended or not select.select([self._descriptor], [], [], 0.0)[0]:
            return ()
        typed = os.read(self._descriptor, 64)
        self.ended = not typed
        at_terminal = self._before is not None
        keys = [chr(byte) for byte in typed if at_terminal or byte not in b"\r\n"]
        return {KEYS.get(key, Request.STOP) for key in keys}
