"""Referees, who decide how a trial went: pure functions of what was seen in each control step.

Both referees know the same events, and the first one decides, within a step by `hotice.task.rules.PRECEDENCE`. They
differ in what a collision is:

- `exact`: a link of the robot, or the object, touches an obstacle in any physics step; full geometry. A robot that
  stands and is touched by something that moves has been walked into, which counts apart.
- `points`: one of eleven points of the body, or of the object's eight keypoints (a box's corners), is deeper than 4 cm
  in an obstacle by the signed distance of the fields' grid; the first 50 control steps are free. This is the collision
  rule of the public code by the paper's first author; the eleven points are ours: head, shoulders, torso, pelvis, knees
  and feet (the keypoints of the SGF), and hands.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hotice.errors import InvalidConfig, UnknownName
from hotice.task import rules
from hotice.task.rules import OUTCOMES

REFEREES = ("exact", "points")
DEEP_M = 0.04
"""Depth at which a point collides, by the points rule."""
FREE_STEPS = 50
"""Control steps at the start in which the points rule sees no collision."""
STAY_S = 1.0
"""Whether a robot has stayed at the goal is seen so long after its arrival."""


def check_referees(names: Sequence[str]) -> None:
    """Raises `UnknownName` or `InvalidConfig` unless these are referees, each once, `exact` among them."""
    for name in names:
        if name not in REFEREES:
            raise UnknownName("referee", name, REFEREES)
    if len(set(names)) < len(names):
        raise InvalidConfig(f"referees are {', '.join(names)}: name each once")
    if REFEREES[0] not in names:
        raise InvalidConfig(
            f"referees are {', '.join(names) or 'none'}: exact is needed, a report's rates are its rates"
        )


@dataclass(frozen=True, kw_only=True)
class Signals:
    """Observations of N trials after each of T control steps, each (T, N); rows after a trial's end are not read.

    fall, drop, unstable, robot_hit, object_hit: bool. robot_gap_m, object_gap_m: lowest signed distance of the points
    of the body and of the object, infinite where nobody looked. goal_m: root to goal, horizontally. self_depth_m: how
    deep parts of the robot were in each other. met: what was touched moves. way_m: how far the root has come in the
    last half second.
    """

    fall: np.ndarray
    drop: np.ndarray
    unstable: np.ndarray
    robot_hit: np.ndarray
    object_hit: np.ndarray
    robot_gap_m: np.ndarray
    object_gap_m: np.ndarray
    goal_m: np.ndarray
    self_depth_m: np.ndarray
    met: np.ndarray
    way_m: np.ndarray

    @classmethod
    def stacked(cls, steps: Sequence[Signals]) -> Signals:
        """Single control steps (N,) as rows (T, N)."""
        return cls(**{name: np.stack([getattr(s, name) for s in steps]) for name in vars(steps[0])})

    @property
    def over(self) -> np.ndarray:
        """Whether the trial cannot go on: a fall, a drop or a diverged simulation."""
        return self.fall | self.drop | self.unstable


@dataclass(frozen=True)
class Verdict:
    """Outcome of N trials: code (N,) index into `OUTCOMES`, step (N,) control step of the first event, from 1."""

    code: np.ndarray
    step: np.ndarray

    @property
    def outcome(self) -> tuple[str, ...]:
        """Outcomes by name."""
        return tuple(OUTCOMES[i] for i in self.code.tolist())


def exact(signals: Signals, limit: int) -> Verdict:
    """Verdict by contacts of the full geometry; `limit`: control steps of a trial."""
    into = (signals.robot_hit | signals.object_hit) & rules.walked_into(signals.met, signals.way_m)
    return _first(signals, limit, signals.robot_hit & ~into, signals.object_hit & ~into, into)


def points(signals: Signals, limit: int) -> Verdict:
    """Verdict by points of body and object; `limit`: control steps of a trial."""
    late = (np.arange(len(signals.goal_m)) >= FREE_STEPS)[:, None]
    return _first(signals, limit, late & (signals.robot_gap_m < -DEEP_M), late & (signals.object_gap_m < -DEEP_M))


def _first(
    signals: Signals, limit: int, robot: np.ndarray, load: np.ndarray, into: np.ndarray | None = None
) -> Verdict:
    """The first event of each trial."""
    seen = {name: getattr(signals, name) for name in ("unstable", "fall", "drop")}
    late = np.zeros(signals.goal_m.shape, dtype=bool)
    late[limit - 1 :] = True
    code = rules.outcome_code(
        np.zeros(signals.goal_m.shape, dtype=np.int64),
        **seen,
        robot_collision=robot,
        object_collision=load,
        walked_into=np.zeros_like(robot) if into is None else into,
        success=rules.arrived(signals.goal_m),
        timeout=late,
    )[:limit]
    at = (code > 0).argmax(axis=0)
    return Verdict(code[at, np.arange(code.shape[1])], at + 1)


def deepest(signals: Signals, verdict: Verdict) -> np.ndarray:
    """Deepest self-penetration before each trial's end, (N,) [m]; self contact ends no trial."""
    before = np.arange(len(signals.self_depth_m))[:, None] < verdict.step
    return np.where(before, signals.self_depth_m, 0.0).max(axis=0)


@dataclass(frozen=True)
class Afterwards:
    """State of N trials at the time limit, by the exact referee: see `afterwards`. Each (N,)."""

    distance_m: np.ndarray
    standing: np.ndarray
    stayed: np.ndarray


def afterwards(signals: Signals, limit: int, stay: int) -> Afterwards:
    """Course of the trials after the arrivals; `stay`: control steps in `STAY_S`.

    distance_m: root to goal at the time limit, of failures and of whoever falls or drops later where that happened.
    standing: arrived, and up to the limit upright, with the load in the hands and free of contact. stayed: arrived,
    there `stay` steps later and upright until then, also where that is after the limit.
    """
    verdict = exact(signals, limit)
    trials, last = np.arange(len(verdict.code)), len(signals.goal_m) - 1
    arrived, at = verdict.code == OUTCOMES.index("success"), verdict.step - 1
    later = np.arange(len(signals.goal_m))[:, None] > at
    down = later & signals.over
    down_at = np.where(down.any(axis=0), down.argmax(axis=0), last + 1)
    touch = later & (signals.robot_hit | signals.object_hit)
    touch_at = np.where(touch.any(axis=0), touch.argmax(axis=0), last + 1)
    end = np.where(arrived, np.minimum(down_at, min(limit - 1, last)), at)
    then = np.minimum(at + stay, last)
    near = rules.arrived(signals.goal_m[then, trials]) & (down_at > then)
    return Afterwards(
        distance_m=signals.goal_m[end, trials],
        standing=arrived & (np.minimum(down_at, touch_at) >= limit),
        stayed=arrived & near,
    )
