"""Events on the time line of a rollout: changes of mode, faults, notes, touches."""

from __future__ import annotations

import math
from dataclasses import dataclass

from hotice.errors import UnknownName
from hotice.replay.shown import InvalidRollout

KINDS = ("mode", "fault", "note", "touch")
MOST_TEXT = 400
MOST_TOUCHES = 50
"""Of one rollout that are told, each pair of solids once."""


@dataclass(frozen=True, kw_only=True)
class RolloutEvent:
    """What happened at an instant. Raises `InvalidRollout` for a time that is none, `UnknownName` for a kind."""

    time_s: float
    """On the clock of the record's `time_s` [s]; it may lie before the first frame or after the last."""
    kind: str
    """mode, fault, note or touch."""
    text: str
    solids: tuple[str, ...] = ()
    """Names of solids and obstacles that it is about, which are marked from then on."""

    def __post_init__(self) -> None:
        if not isinstance(self.time_s, float | int) or not math.isfinite(self.time_s):
            raise InvalidRollout(f"time of an event is {self.time_s!r}: a finite number is needed")
        if self.kind not in KINDS:
            raise UnknownName("kind of event", self.kind, KINDS)
        if not isinstance(self.text, str) or len(self.text) > MOST_TEXT:
            raise InvalidRollout(f"text of an event has to be a text of at most {MOST_TEXT} characters")
        if not isinstance(self.solids, list | tuple) or not all(isinstance(name, str) for name in self.solids):
            raise InvalidRollout("solids of an event have to be a list of names")
        object.__setattr__(self, "solids", tuple(self.solids))
