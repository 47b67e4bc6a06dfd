"""Letters that whoever runs a simulated robot types: keys of its gamepad."""

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


def pressed_by(typed: bytes) -> list[tuple[str, ...]]:
    """Keys of the gamepad for each letter typed; letters without one are left."""
    return [KEYS[letter] for letter in typed.decode(errors="replace") if letter in KEYS]
