"""Frames of the page: a moment of a session as JSON values."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from hotice.policy import PerceptModel
from hotice.policy.percept import NUM_SGF
from hotice.replay.html import describe
from hotice.replay.rollout import RolloutRecord
from hotice.replay.shown import ShownSolids
from hotice.view.session import Session
from hotice.view.ways import slice_of, ways

Fact = tuple[str, str, bool]
"""Name, text, and whether it is marked."""
WAYS_EVERY = 5
"""Frames from one look at the planned ways to the next, unless the fields are new."""
BEHIND_S = 0.2
"""Fields that lack a change for longer than this are marked [s]."""
SLOW = 0.95
"""Below this share of real time it is marked."""


class Painter:
    """Draws a session; `pace`: the share of real time that the loop keeps."""

    def __init__(self, session: Session) -> None:
        self._session, self.pace = session, 1.0
        self._carried, self._solids = session.choice.carried, self._made_solids()
        self._ways: list[dict[str, Any]] = []
        self._ways_of: tuple[int, float] = (-1, -1.0)
        self._frames = 0
        self._slice: dict[str, Any] | None = None
        self._slice_of: tuple[Any, ...] = ()

    def first(self) -> RolloutRecord:
        """All solids at the start: a record of one frame."""
        session, count = self._session, session_arrows(self._session)
        return RolloutRecord.from_states(
            self._solids.model,
            session.walk.qpos,
            # frames say where obstacles are, not their motions
            scene=session.scene.at(0.0),
            carried=session.choice.carried,
            time_s=[0.0],
            outcome="running",
            policy=session.choice.policy,
            arrow_pos_W=np.zeros((1, len(count), 3)),
            arrow_force_W=np.zeros((1, len(count), 3)),
            arrow_is_ogf=count,
        )

    def frame(self) -> dict[str, Any]:
        """The moment now; numbers in m, rounded to 0.1 mm."""
        session, self._frames = self._session, self._frames + 1
        if session.choice.carried is not self._carried:
            self._carried, self._solids = session.choice.carried, self._made_solids()
        placed, percept, reading = self._solids.place(session.walk.qpos), session.walk.percept, session.walk.reading
        mode, tone = mode_of(session)
        kind, size = session.choice.carried.mujoco_geom()
        return {
            "time": round(session.walk.time_s, 2),
            "mode": mode,
            "tone": tone,
            "facts": list(self._facts()),
            "events": session.walk.events,
            "policy": session.choice.policy,
            "carried": describe(session.choice.carried),
            "object": {"type": kind, "size": size},
            "geom_pos": _rounded(placed.pos_W),
            "geom_quat": _rounded(placed.quat_W),
            "root_pos": _rounded(placed.root_pos_W),
            "object_pos": _rounded(placed.object_pos_W),
            "arrow_pos": _rounded(np.concatenate([percept.p_WK, percept.p_WOK])),
            "arrow_force": _rounded(np.nan_to_num(reading.force_W)),
            "obstacles": [[*o.position_m, *o.quaternion_wxyz] for o in session.obstacles],
            "touching": sorted({name for pair in session.walk.world.touched for name in pair}),
            "version": session.live.newest.version,
            "behind": round(session.live.behind_s, 3),
            "ways": self._planned(),
            "slice": self._sliced(),
            "chosen": {
                "policy": session.choice.policy,
                "noise": session.choice.noise,
                "paused": session.paused,
                "object": session.choice.carried.to_dict(),
            },
        }

    def _made_solids(self) -> ShownSolids:
        return ShownSolids(PerceptModel(self._session.choice.carried).model)

    def _planned(self) -> list[dict[str, Any]]:
        version = self._session.live.newest.version
        if self._ways_of != (version, self._session.walk.time_s) and (
            self._ways_of[0] != version or self._frames % WAYS_EVERY == 0
        ):
            pf = self._session.live.fields
            self._ways = ways(pf.sgf, pf.ogf, self._session.walk.percept)
            self._ways_of = version, self._session.walk.time_s
        return self._ways

    def _sliced(self) -> dict[str, Any] | None:
        asked, built = self._session.slice, self._session.live.newest
        if asked.field == "none":
            return None
        if self._slice_of != (built.version, asked):
            guide = getattr(built.fields, asked.field)
            shown = slice_of(guide, built.fields.scene, asked.height_m)
            self._slice, self._slice_of = {"field": asked.field, **shown}, (built.version, asked)
        return self._slice

    def _facts(self) -> Iterator[Fact]:
        session, built = self._session, self._session.live.newest
        reading, behind_s = session.walk.reading, session.live.behind_s
        yield "To the goal", f"{float(reading.goal_distance[0]):.2f} m", False
        command = "{:.2f}, {:.2f}, {:.2f} m/s".format(*reading.c_W.tolist())
        yield "Command", "none: stands" if session.walk.standing else command, False
        # the object's field is of obstacles that are larger by the margin
        margin_m = session.live.margin_m * session_arrows(session)
        nearest_m = float((reading.distance + margin_m).min())
        yield "Nearest", f"{nearest_m:.2f} m", nearest_m < 0.0
        yield "Touches", str(len(session.walk.touches)), bool(session.walk.touches)
        shows = f"{behind_s:.1f} s behind the obstacles" if behind_s > BEHIND_S else "as the obstacles are"
        yield "Fields", shows, behind_s > BEHIND_S
        yield "", f"no. {built.version}, built in {1e3 * (built.ready_s - built.given_s):.0f} ms", False
        yield "Real time", f"{100.0 * self.pace:.0f} %", self.pace < SLOW


def mode_of(session: Session) -> tuple[str, str]:
    """What the robot does in words, and how that is: walking, success, waits or failure."""
    if session.walk.over:
        return session.walk.over, "failure"
    if session.paused:
        return "paused", "waits"
    if session.walk.standing == "at the goal":
        return "at the goal", "success"
    return (f"stands: {session.walk.standing}", "waits") if session.walk.standing else ("walking", "walking")


def session_arrows(session: Session) -> np.ndarray:
    """(19,) which arrows are of the object's own field, if the policy reads one."""
    count = len(session.walk.reading.force_W)
    return (np.arange(count) >= NUM_SGF) & (session.walk.task.object_field == "ogf")


def _rounded(values: np.ndarray) -> list[float]:
    return np.round(values, 4).ravel().tolist()
