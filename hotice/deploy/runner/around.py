"""Surroundings of a robot in which something moves: fields with it, and how old what they know is."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hotice.deploy.estimate.movers import MoverTracker
from hotice.deploy.estimate.seen import OK
from hotice.deploy.runner.ways import Built, Ways
from hotice.fields.hod_pf import HodPf
from hotice.fields.moving.momentary import MomentaryPf, momentary_pf, moved

Array = NDArray[np.float64]
OLD_S = 1.0
"""Who last saw what moves longer ago than this does not walk: it is the guard's limit of localization. Ways among what
moves that are older do not count: those of what never moves do."""


class Around:
    """Call `look` once a tick, then read `fields`.

    Args:
        still: both fields of what never moves
        tracker: of what does
        ways: builds those of the moment; None: ways are those of what never moves

    Attributes:
        fields: with what moves where it is taken to be; before it was seen those of what never moves.
        poses: where it is taken to be (M, 7), position [m] and quaternion wxyz in W; None before it was seen.
        age_s: since it was seen [s].
        built: the ways that `fields` have; None: those of what never moves.
    """

    def __init__(self, still: HodPf, tracker: MoverTracker, ways: Ways | None = None) -> None:
        self._still, self._tracker, self._ways = still, tracker, ways
        self._shown_s = -np.inf
        self.fields: HodPf | MomentaryPf = still
        self.poses: Array | None = None
        self.age_s = np.inf
        self.built: Built | None = None

    def look(self, now_s: float) -> None:
        """Takes what has come, and moves all to where it is taken to be at `now_s` [s]."""
        tracker, ways = self._tracker, self._ways
        tracker.look(now_s)
        self.age_s, self.fields = tracker.age_s(now_s), self._still
        if tracker.newest is None:
            return
        if ways is not None:
            if tracker.newest.measured_s != self._shown_s:
                self._shown_s = tracker.newest.measured_s
                ways.show(*tracker.newest)
            newest = ways.newest()
            self.built = newest if newest and now_s - newest.measured_s <= OLD_S else None
        self.poses = tracker.poses(now_s)
        movers = moved(tracker.moving, self.poses)
        self.fields = momentary_pf(self._still, movers, None if self.built is None else self.built.fields)

    def guess(self) -> MomentaryPf:
        """Fields with all where the scene's file has it, for who compiles and loads everything beforehand."""
        return momentary_pf(self._still, [o.at(0.0) for o in self._tracker.moving], self._still)

    @property
    def sure(self) -> bool:
        """Whether what is known is new enough to walk by."""
        return self.age_s <= OLD_S

    @property
    def verdict(self) -> str:
        """What there is to say: "ok", or why what moves is not known."""
        if self._tracker.verdict != OK:
            return self._tracker.verdict
        if not self.sure:
            return f"seen {self.age_s:.0f} s ago"
        return OK if self._ways is None or self.built else "ok, without ways of the moment"
