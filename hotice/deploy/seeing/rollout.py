"""A run as a rollout record: what the replay page, pictures and films show."""

from __future__ import annotations

import numpy as np

from hotice.deploy.guard.faults import Cause
from hotice.deploy.seeing.moments import arrows_of, is_ogf, percept_of, spoken, state_of
from hotice.deploy.seeing.recorded import LoggedEvent, RecordedRun
from hotice.policy.percept import PerceptModel
from hotice.replay.events import MOST_TEXT, RolloutEvent
from hotice.replay.rollout import RolloutRecord

CALM = {spoken(cause.name) for cause in (Cause.NONE, Cause.OPERATOR, Cause.DONE)}
"""Causes that are no faults."""
ENDINGS = {spoken(Cause.DONE.name): "success", spoken(Cause.LEAN.name): "fall"}
"""Outcome of a run by the first of these causes; without any it is "running"."""


def rollout_record(run: RecordedRun) -> RolloutRecord:
    """The robot with the joints that were measured, where the estimate had it, and the object where it was believed.

    A frame for each moment. A run in which the guard saw the goal reached is a success, one in which it saw the robot
    lean too far before that is a fall. Changes of mode and faults are its events.
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
        outcome=next((ENDINGS[event.cause] for _, event in run.events if event.cause in ENDINGS), "running"),
        policy=run.policy,
        arrow_pos_W=points,
        arrow_force_W=forces,
        arrow_is_ogf=is_ogf(run.object_field),
        events=shown_events(run.events),
    )


def shown_events(events: list[tuple[float, LoggedEvent]]) -> tuple[RolloutEvent, ...]:
    """Events for a time line: a change of mode is one, any other cause a fault, the rest notes."""
    shown, before = [], "off"
    for t, event in events:
        kind = "mode" if event.mode != before else "note" if event.cause in CALM else "fault"
        text = f"{event.mode}: {event.text}" if kind == "mode" else event.text
        shown.append(RolloutEvent(time_s=t, kind=kind, text=text[:MOST_TEXT]))
        before = event.mode
    return tuple(shown)
