"""Keyboard of whoever runs a simulated robot in a terminal: letters as keys of its gamepad."""

from __future__ import annotations

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


def pressed(letters: bytes) -> list[tuple[str, ...]]:
    """Keys of the gamepad for each letter that was typed; letters without one are left."""
    return [KEYS[letter] for letter in letters.decode(errors="replace") if letter in KEYS]
