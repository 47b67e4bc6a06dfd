"""Modes of the guard, what the operator may ask, and which mode follows: towards motion with a key only."""

from __future__ import annotations

from enum import Enum, IntEnum


class Mode(IntEnum):
    """What the guard does; numbers as in the slot's status."""

    OFF = 0
    """Sends nothing."""
    DAMPING = 1
    """Motors brake, none holds; the arms keep their squeeze for a moment."""
    POSTURE = 2
    """From where the joints are to the posture, slowly, gains growing."""
    READY = 3
    """Holds the posture; a box may be handed over. Nobody balances: the robot hangs or is held."""
    PICK_UP = 4
    """The runner picks up."""
    CARRY = 5
    """The runner walks to the goal."""
    HOLD = 6
    """The runner stands on the spot: its goal is where it began to stand."""
    LOWER = 7
    """The runner puts the box down."""


DRIVEN = (Mode.PICK_UP, Mode.CARRY, Mode.HOLD, Mode.LOWER)
"""Modes in which the motors follow the runner."""
SQUEEZING = (Mode.READY, *DRIVEN)
"""Modes in which the hands may have a box."""


class Request(Enum):
    """Wishes of the operator. Of several at once that lead on, the first in this order counts: the calmest."""

    STOP = "stop"
    HOLD = "hold"
    LOWER = "lower"
    START = "start"
    POSTURE = "posture"
    PICK_UP = "pick-up"
    CARRY = "carry"


NEXT: dict[tuple[Mode, Request], Mode] = {
    (Mode.OFF, Request.START): Mode.DAMPING,
    (Mode.DAMPING, Request.POSTURE): Mode.POSTURE,
    (Mode.READY, Request.PICK_UP): Mode.PICK_UP,
    (Mode.READY, Request.CARRY): Mode.CARRY,
    (Mode.PICK_UP, Request.CARRY): Mode.CARRY,
    (Mode.PICK_UP, Request.HOLD): Mode.HOLD,
    (Mode.CARRY, Request.HOLD): Mode.HOLD,
    (Mode.CARRY, Request.LOWER): Mode.LOWER,
    (Mode.HOLD, Request.CARRY): Mode.CARRY,
    (Mode.HOLD, Request.LOWER): Mode.LOWER,
}
"""Where a wish leads; any other pair changes nothing, but for STOP, which leads from every mode but OFF to DAMPING."""


def wished(mode: Mode, request: Request) -> Mode:
    """The mode after a wish of the operator."""
    if request is Request.STOP:
        return mode if mode is Mode.OFF else Mode.DAMPING
    return NEXT.get((mode, request), mode)
