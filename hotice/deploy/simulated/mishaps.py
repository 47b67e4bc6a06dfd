"""Mishaps of a simulated robot, by name and time: `tag-loss@3s`, `tick-frozen@4s+0.5s`."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

from hotice.deploy.link.faults import Faults
from hotice.deploy.simulated.timed import timed
from hotice.errors import InvalidConfig, UnknownName

LINK_FAULTS: dict[str, dict] = {
    "state-silent": {"lost": 1.0},
    "state-lost": {"lost": 0.2},
    "state-late": {"late": 1.0, "late_s": 0.06},
    "state-doubled": {"doubled": 1.0},
    "state-bad-crc": {"bad_crc": 1.0},
    "state-nan": {"nan": 1.0},
    "tick-frozen": {"frozen_tick": True},
}
"""Of states on their way, as `Faults`."""
MISHAPS = {
    **{
        "state-silent": "no states",
        "state-lost": "a fifth of the states is lost",
        "state-late": "states come 60 ms late",
        "state-doubled": "each state comes twice",
        "state-bad-crc": "states have a wrong checksum",
        "state-nan": "one number in each state is not a number",
        "tick-frozen": "the tick stands still",
    },
    "push": "the pelvis is pushed once by 1 m/s, in a direction drawn by the seed",
    "second-publisher": "somebody else sends damping commands, 500 a second",
    "remote-loss": "the gamepad is out of reach",
    "battery-low": "the battery has 5 %",
    "motor-hot": "all windings are 120 °C warmer",
    "motor-error": "the left knee reports an error",
    "encoder-jump": "the left knee's encoder reads 1 rad more",
    "joints-swapped": "left and right knee are swapped in the states",
    "tag-loss": "the camera finds no tags",
    "tag-foreign": "each tag has an id that no box has",
    "pose-loss": "localization is silent",
    "pose-frozen": "localization says again and again where the robot was",
    "pose-jump": "localization is 0.2 m off",
    "pose-turn": "localization is turned by 30°",
    "pose-nan": "localization says not a number",
    "movers-loss": "who sees obstacles that move is silent",
    "movers-nan": "who sees obstacles that move says not a number",
}
"""Every mishap and what happens."""
ONCE = ("battery-low", "push")
"""Those that happen at an instant, so that no duration ends them."""


@dataclass(frozen=True, kw_only=True)
class Mishap:
    """One mishap from `from_s` until `until_s` of the robot's time [s]."""

    name: str
    from_s: float
    until_s: float = math.inf

    @classmethod
    def parse(cls, text: str) -> Mishap:
        """From `NAME@STARTs` or `NAME@STARTs+DURATIONs`. Raises `UnknownName`, `InvalidConfig`."""
        name, from_s, for_s = timed("fault", text, "tag-loss@3s or tick-frozen@4s+0.5s")
        if name not in MISHAPS:
            raise UnknownName("fault", name, MISHAPS)
        if name in ONCE and for_s is not None:
            raise InvalidConfig(f"fault is {text!r}: {name} happens once, at its start; leave the duration out")
        return cls(name=name, from_s=from_s, until_s=math.inf if for_s is None else from_s + for_s)


class Mishaps:
    """All that goes wrong with one robot."""

    def __init__(self, mishaps: Iterable[Mishap]) -> None:
        self._all = tuple(mishaps)
        self._begun: set[Mishap] = set()

    def now(self, name: str, time_s: float) -> bool:
        """Whether it goes on at this time."""
        return any(m.name == name and m.from_s - 1e-9 <= time_s < m.until_s - 1e-9 for m in self._all)

    def begins(self, name: str, time_s: float) -> bool:
        """Whether it is to begin, once each."""
        for mishap in self._all:
            if mishap.name == name and mishap not in self._begun and mishap.from_s <= time_s + 1e-9:
                self._begun.add(mishap)
                return True
        return False

    def of_states(self) -> list[Faults]:
        """Those of states on their way."""
        return [
            Faults(**LINK_FAULTS[m.name], from_s=m.from_s, until_s=m.until_s)
            for m in self._all
            if m.name in LINK_FAULTS
        ]
