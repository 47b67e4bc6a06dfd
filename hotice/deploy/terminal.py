"""What is typed at a program, as it is typed and without waiting."""

from __future__ import annotations

import io
import os
import select
import sys
import termios
import tty


class Terminal:
    """Bytes of a descriptor: of a terminal each key as it is pressed, of a pipe all. Use `with`."""

    def __init__(self, descriptor: int | None = None) -> None:
        """Standard input, unless another descriptor is given; a program without one has nothing typed."""
        self._descriptor = _standard_input() if descriptor is None else descriptor
        self._before: list | None = None
        self.ended = self._descriptor is None
        """Whether nothing can come any more: a pipe's other end is closed."""

    def __enter__(self) -> Terminal:
        if self._descriptor is not None and os.isatty(self._descriptor):
            self._before = termios.tcgetattr(self._descriptor)
            tty.setcbreak(self._descriptor)
        return self

    def __exit__(self, *_: object) -> None:
        if self._descriptor is not None and self._before is not None:
            termios.tcsetattr(self._descriptor, termios.TCSADRAIN, self._before)

    @property
    def there(self) -> bool:
        """Whether it is a terminal."""
        return self._before is not None

    def typed(self) -> bytes:
        """What was typed since the last call, at most 64 bytes."""
        if self._descriptor is None or self.ended or not select.select([self._descriptor], [], [], 0.0)[0]:
            return b""
        typed = os.read(self._descriptor, 64)
        self.ended = not typed
        return typed


def _standard_input() -> int | None:
    try:
        return None if sys.stdin is None else sys.stdin.fileno()
    except io.UnsupportedOperation:
        return None
