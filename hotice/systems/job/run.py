"""One whole job: a station runs until the referee has seen the object put down, a failure, or time is over."""

# pydrake's stubs type arrays as numpy does not:
# pyright: reportArgumentType=false, reportIndexIssue=false

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, EventStatus

from hotice.systems.hand_over.mode_selector import MODES
from hotice.systems.job.referee import STAGE_OF, JobReferee
from hotice.task.rules import MOVES_M_S, STANDS_M, STOOD_S, arrived

if TYPE_CHECKING:
    from hotice.systems.station.make import Station

OUTCOMES = (
    "success",
    "not_lifted",
    "not_handed_over",
    "fall",
    "drop",
    "robot_collision",
    "object_collision",
    "unstable",
    "not_arrived",
    "not_taken_over",
    "put_down_wrong",
)
"""Ends of a job, in its order. Not handed over: lifted, but nobody carried it. Fall to unstable: on the way. Not taken
over: arrived, but no put-down began."""
LIMIT_S = {"pickup": 45.0, "carry": 20.0, "putdown": 50.0}
"""Longest time of each stage (ours)."""
LOOK_S = 0.1


@dataclass(frozen=True, kw_only=True)
class JobResult:
    """End of a job.

    outcome: of `OUTCOMES`; why: in words, empty for a success; time_s: when; seconds: of each stage that was begun.
    goal_m: least distance of the root to the goal while carrying. away_m, lean_rad, apart_m: of the object put down,
    from its place, from upright, hands off it. Not a number where it did not come to that.
    """

    outcome: str
    why: str
    time_s: float
    seconds: dict[str, float]
    goal_m: float = float("nan")
    away_m: float = float("nan")
    lean_rad: float = float("nan")
    apart_m: float = float("nan")

    def __str__(self) -> str:
        if self.outcome == "success":
            return f"put down {100 * self.away_m:.1f} cm from its place, {self.time_s:.0f} s"
        return f"{self.outcome.replace('_', ' ')} after {self.time_s:.0f} s: {self.why}"


class _Watch:
    """What a monitor of the simulator sees: stages, the first failure, how long the object has stood."""

    def __init__(self, station: Station) -> None:
        self.referee, self._station = JobReferee(station), station
        self._plant = station.GetSubsystemByName("plant")
        self._selector = station.GetSubsystemByName("mode_selector")
        self._mode = self._selector.GetOutputPort("mode")
        self._state = self._plant.GetOutputPort("state")
        self._nq = self._plant.nq
        self.stage, self.begun, self.failed = "pickup", {"pickup": 0.0}, ""
        self.stood_since, self._stood_at = np.inf, np.zeros(2)
        self._looked = -np.inf

    def __call__(self, context: Context) -> EventStatus:
        now = context.get_time()
        mode = int(self._mode.Eval(self._selector.GetMyContextFromRoot(context))[0])
        stage = STAGE_OF[MODES[mode]]
        if stage != self.stage:
            self.stage, self.begun[stage] = stage, now
        state = np.asarray(self._state.Eval(self._plant.GetMyContextFromRoot(context)))
        self.failed = self.referee.failure(stage, state[: self._nq], state[self._nq :])
        if stage == "putdown" and now - self._looked >= LOOK_S - 1e-9:
            self._looked = now
            self._look(now, state[:2], float(np.linalg.norm(state[self._nq : self._nq + 3])))
        if self.failed or now - self.stood_since >= STOOD_S - 1e-9:
            return EventStatus.ReachedTermination(self._station, self.failed or "put down")
        return EventStatus.Succeeded()

    def _look(self, now: float, root: np.ndarray, speed_m_s: float) -> None:
        if not self.referee.placed() or speed_m_s > MOVES_M_S:
            self.stood_since = np.inf
        elif not np.isfinite(self.stood_since) or np.linalg.norm(root - self._stood_at) >= STANDS_M:
            self.stood_since, self._stood_at = now, root.copy()


def run_job(station: Station, simulator: Simulator | None = None) -> JobResult:
    """Runs a station of controller `job` to its end; `simulator`: at its start, for who reads its logs afterwards."""
    simulator = simulator or Simulator(station)
    context, watch = simulator.get_context(), _Watch(station)
    simulator.set_monitor(watch)
    simulator.Initialize()
    over = ""
    while not watch.failed and context.get_time() - watch.stood_since < STOOD_S - 1e-9:
        if context.get_time() - watch.begun[watch.stage] >= LIMIT_S[watch.stage]:
            over = "time is over"
            break
        simulator.AdvanceTo(context.get_time() + LOOK_S)
    return _result(watch, context.get_time(), watch.failed or over)


def _result(watch: _Watch, time_s: float, failed: str) -> JobResult:
    referee, stage = watch.referee, watch.stage
    begins = [*watch.begun.values(), time_s]
    seconds = {name: end - begin for name, begin, end in zip(watch.begun, begins, begins[1:], strict=False)}
    numbers = {"time_s": time_s, "seconds": seconds}
    if stage != "pickup":
        numbers["goal_m"] = referee.least_goal_m
    if stage == "putdown":
        referee.placed()
        numbers |= {"away_m": referee.away_m, "lean_rad": referee.lean_rad, "apart_m": referee.apart_m}
    if not failed:
        return JobResult(outcome="success", why="", **numbers)
    if stage == "pickup":
        outcome = "not_handed_over" if referee.lifted else "not_lifted"
    elif stage == "putdown":
        outcome = "put_down_wrong"
    elif failed in OUTCOMES:
        outcome = failed
    else:
        outcome = "not_taken_over" if arrived(referee.least_goal_m) else "not_arrived"
    why = f"{failed} in {stage}".replace("_", " ")
    return JobResult(outcome=outcome, why=f"{why}: {referee.touched}" if referee.touched else why, **numbers)
