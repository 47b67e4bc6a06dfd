"""A run as a rollout record: what the replay page, pictures and films show."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from hotice.deploy.guard.faults import Cause
from hotice.deploy.guard.modes import Mode
from hotice.deploy.seeing.moments import CALM, arrows_of, is_ogf, percept_of, spoken, state_of
from hotice.deploy.seeing.recorded import LoggedEvent, RecordedRun
from hotice.policy.percept import PerceptModel
from hotice.replay.events import MOST_TEXT, RolloutEvent
from hotice.replay.rollout import RolloutRecord

FALLS = (Cause.LEAN, Cause.FALLING, Cause.JOINT_SPEED, Cause.GYRO)
ENDINGS = {
    (spoken(Mode.HOLD.name), spoken(Cause.DONE.name)): "success",
    **{(spoken(Mode.DAMPING.name), spoken(c.name)): "fall" for c in FALLS},
}
"""Outcome of a run by the first of these changes, of the mode that begins and why; without any it is "running". The
posture is reached by the same cause as the goal, and a robot that brakes already may lean as it likes."""
UNKNOWN_S = 0.2
"""A longer time without a moment is told: a page moves the robot evenly over it, which nobody saw [s] (ours)."""


def rollout_record(run: RecordedRun) -> RolloutRecord:
    """The robot with the joints that were measured, where the estimate had it, and the object where it was believed.

    A frame for each moment. A run in which the robot stood still because its goal was reached is a success, one in
    which the guard braked because the robot fell, before that, is a fall. Its events are changes of mode, faults,
    and times at which nothing was known.
    """
    moments = run.moments
    points, forces = zip(
        *(arrows_of(percept_of(each), reading) for each, reading in zip(moments, run.readings, strict=True)),
        strict=True,
    )
    return RolloutRecord.from_states(
        PerceptModel(run.carried).model,
        np.array([state_of(each) for each in moments]),
        scene=run.scene,
        carried=run.carried,
        time_s=moments["time_s"],
        outcome=outcome_of(run.events),
        policy=run.policy,
        arrow_pos_W=points,
        arrow_force_W=forces,
        arrow_is_ogf=is_ogf(run.object_field),
        events=sorted([*shown_events(run.events), *unknown(moments["time_s"])], key=lambda event: event.time_s),
    )


def kinds_of(events: list[tuple[float, LoggedEvent]]) -> list[str]:
    """Kind of each: a change of mode is "mode", any other cause a "fault", the rest a "note".

    No log begins with a change that a fault made, but a ring whose beginning is gone may with a fault that was told.
    """
    kinds, before = [], None
    for _, event in events:
        calm = event.cause in CALM
        begins = event.mode != before and (calm or before is not None)
        kinds.append("mode" if begins else "note" if calm else "fault")
        before = event.mode
    return kinds


def unknown(time_s: np.ndarray) -> list[RolloutEvent]:
    """A fault at each moment (T,) [s] after which robot or box were not known for a while."""
    return [
        RolloutEvent(time_s=float(a), kind="fault", text=f"robot or box not known for {b - a:.2f} s")
        for a, b in pairwise(time_s)
        if b - a > UNKNOWN_S
    ]


def outcome_of(events: list[tuple[float, LoggedEvent]]) -> str:
    """`success`, `fall` or `running`: nothing was decided; see `ENDINGS`."""
    for (_, event), kind in zip(events, kinds_of(events), strict=True):
        if kind == "mode" and (event.mode, event.cause) in ENDINGS:
            return ENDINGS[event.mode, event.cause]
    return "running"


def shown_events(events: list[tuple[float, LoggedEvent]]) -> tuple[RolloutEvent, ...]:
    """Events for a time line; a change of mode that a fault made is shown as a fault."""
    shown = []
    for (t, event), kind in zip(events, kinds_of(events), strict=True):
        text = f"{event.mode}: {event.text}" if kind == "mode" else event.text
        kind = kind if event.cause in CALM else "fault"
        shown.append(RolloutEvent(time_s=t, kind=kind, text=text[:MOST_TEXT]))
    return tuple(shown)
