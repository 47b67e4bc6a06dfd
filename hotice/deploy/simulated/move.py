"""Joints that are to be moved by hand, and when, as a user writes it."""

from __future__ import annotations

from dataclasses import dataclass

from hotice.deploy.simulated.timed import timed
from hotice.errors import InvalidConfig, UnknownName
from hotice.model import g1

ALL = "all"
MOVE_S, PAUSE_S = 2.0, 2.0
"""There and back with one joint, and the pause before the next, where all are moved."""


@dataclass(frozen=True, kw_only=True)
class Move:
    """One joint moved by hand, there and back, from `from_s` on for `MOVE_S` [s]."""

    joint: int
    from_s: float

    @classmethod
    def parse(cls, text: str) -> list[Move]:
        """From `JOINT@STARTs`, or `all@STARTs` for each joint in turn. Raises `UnknownName`, `InvalidConfig`."""
        what, from_s, for_s = timed("move", text, "left_knee_joint@3s or all@5s")
        if for_s is not None:
            raise InvalidConfig(f"move is {text!r}: a joint is moved for {MOVE_S:g} s; leave the duration out")
        if what == ALL:
            return [cls(joint=i, from_s=from_s + i * (MOVE_S + PAUSE_S)) for i in range(len(g1.ALL_JOINTS))]
        if what not in g1.ALL_JOINTS:
            raise UnknownName("joint", what, (ALL, *g1.ALL_JOINTS))
        return [cls(joint=g1.ALL_JOINTS.index(what), from_s=from_s)]
