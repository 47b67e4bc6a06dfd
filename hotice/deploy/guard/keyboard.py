"""The keyboard as the operator's wishes: known keys ask, every other key stops."""

from __future__ import annotations

from collections.abc import Iterable

from hotice.deploy.guard.modes import Request
from hotice.deploy.terminal import Terminal

KEYS = {
    "s": Request.START,
    "p": Request.POSTURE,
    "u": Request.PICK_UP,
    "c": Request.CARRY,
    "h": Request.HOLD,
    "l": Request.LOWER,
}


class Keyboard:
    """Keys of a `Terminal`, each as it is pressed; of a pipe, each character but line ends. Use `with`."""

    def __init__(self, descriptor: int | None = None) -> None:
        """See `Terminal`."""
        self._terminal = Terminal(descriptor)

    @property
    def ended(self) -> bool:
        """Whether a pipe's other end is closed: nobody is there any more."""
        return self._terminal.ended

    def __enter__(self) -> Keyboard:
        self._terminal.__enter__()
        return self

    def __exit__(self, *_: object) -> None:
        self._terminal.__exit__()

    def __call__(self) -> Iterable[Request]:
        """Wishes since the last call, without waiting."""
        typed = self._terminal.typed()
        keys = [chr(byte) for byte in typed if self._terminal.there or byte not in b"\r\n"]
        return {KEYS.get(key, Request.STOP) for key in keys}
