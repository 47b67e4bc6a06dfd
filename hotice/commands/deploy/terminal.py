"""What is typed at `hotice deploy` or `hotice robot-sim`, as it is typed."""

from __future__ import annotations

import os
import select
import sys
import termios
import tty


class Terminal:
    """Bytes from this program's standard input without waiting: of a terminal each key, of a pipe all. Use `with`."""

    def __init__(self) -> None:
        self._before: list | None = None
        self._ended = sys.stdin is None

    def __enter__(self) -> Terminal:
        if not self._ended and sys.stdin.isatty():
            self._before = termios.tcgetattr(sys.stdin)
            tty.setcbreak(sys.stdin)
        return self

    def __exit__(self, *_: object) -> None:
        if self._before is not None:
            termios.tcsetattr(sys.stdin, termios.TCSADRAIN, self._before)

    @property
    def there(self) -> bool:
        """Whether there is a terminal."""
        return self._before is not None

    def typed(self) -> bytes:
        """What was typed since the last call; nothing once the input has ended."""
        if self._ended or not select.select([sys.stdin], [], [], 0.0)[0]:
            return b""
        typed = os.read(sys.stdin.fileno(), 64)
        self._ended = not typed
        return typed
