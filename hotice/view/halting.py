"""Whether the robot stands, and why: the goal is reached, no way leads there, or its fields are old."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hotice.fields.live import LiveField
from hotice.model.scene import GOAL_HEIGHT_M
from hotice.policy import Percept
from hotice.policy.guidance import FieldReading
from hotice.task.rules import arrived

Array = NDArray[np.float64]
GOAL, NO_WAY, OLD = "at the goal", "no way", "old fields"
BACK_M = 0.3
"""Who stood at the goal goes back to it when it was pushed further away than this [m] (ours)."""
OLD_S = 1.0
"""Who would walk by fields that lack a change for longer than this stands [s] (ours)."""


class Halting:
    """Remembers why it stands, and where."""

    def __init__(self) -> None:
        self.why = ""
        """One of `GOAL`, `NO_WAY`, `OLD`; empty: it walks."""
        self.place_W: Array = np.zeros(3)
        """Where it stands (3,) [m], at the height of goals."""
        self._seen, self._way = -1, True

    def look(self, live: LiveField, percept: Percept, reading: FieldReading) -> str:
        """Why it has to stand now; empty: it walks on."""
        goal_m, before = float(reading.goal_distance[0]), self.why
        if arrived(goal_m) or (before == GOAL and goal_m < BACK_M):
            self.why = GOAL
        elif live.behind_s > OLD_S:
            self.why = OLD
        else:
            self.why = "" if self._has_way(live, percept) else NO_WAY
        if self.why == GOAL:
            self.place_W = live.scene.goal_W
        elif self.why and not before:
            self.place_W = np.array([*percept.p_WP[:2], GOAL_HEIGHT_M])
        return self.why

    def _has_way(self, live: LiveField, percept: Percept) -> bool:
        """Whether a free path leads a point from here to the goal: not that a robot fits through.

        Looked at anew for each pair of fields, and while there is none.
        """
        built = live.newest
        if built.version != self._seen or not self._way:
            self._seen = built.version
            here_W = np.array([[*percept.p_WP[:2], GOAL_HEIGHT_M]])
            self._way = bool(np.isfinite(built.fields.sgf.geodesic_distance(here_W))[0])
        return self._way
