"""Keyboard of whoever runs a simulated robot in a terminal: letters as keys of its gamepad."""

from __future__ import annotations

import os
import select
import sys
import termios
import tty

KEYS = {
    "s": ("start",),
    "b": ("L2", "B"),
    "p": ("L2", "up"),
    "u": ("R1", "A"),
    "c": ("R1", "X"),
    "h": ("R1", "Y"),
    "l": ("R1", "down"),
    "o": ("F1",),
    "g": ("F2",),
    " ": ("select",),
}
"""Letters: what they press. Space and b stop; o gives the object and lets it go, g lowers the gantry."""


class Terminal:
    """The letters typed at this program's terminal, as they are typed; none without a terminal. Use `with`."""

    def __init__(self) -> None:
        self._before: list | None = None

    def __enter__(self) -> Terminal:
        if sys.stdin is not None and sys.stdin.isatty():
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

    def typed(self) -> list[tuple[str, ...]]:
        """Keys of the gamepad for each letter since the last call, without waiting; letters without one are left."""
        if self._before is None or not select.select([sys.stdin], [], [], 0.0)[0]:
            return []
        letters = os.read(sys.stdin.fileno(), 64).decode(errors="replace")
        return [KEYS[letter] for letter in letters if letter in KEYS]
