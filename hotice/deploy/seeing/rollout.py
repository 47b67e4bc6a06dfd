"""A run as a rollout record: what the replay page, pictures and films show."""

from __future__ import annotations

import numpy as np

from hotice.deploy.guard.faults import Cause
from hotice.deploy.guard.modes import Mode
from hotice.deploy.seeing.moments import arrows_of, is_ogf, percept_of, spoken, state_of
from hotice.deploy.seeing.recorded import LoggedEvent, RecordedRun
from hotice.policy.percept import PerceptModel
from hotice.replay.events import MOST_TEXT, RolloutEvent
from hotice.replay.rollout import RolloutRecord

CALM = {spoken(cause.name) for cause in (Cause.NONE, Cause.OPERATOR, Cause.DONE)}
"""Causes that are no faults."""
ENDINGS = {
    (spoken(Mode.HOLD.name), spoken(Cause.DONE.name)): "success",
    **{(spoken(Mode.DAMPING.name), spoken(c.name)): "fall" for c in (Cause.LEAN, Cause.JOINT_SPEED, Cause.GYRO)},
}
"""Outcome of a run by the first of these changes, of the mode that begins and why; without any it is "running". The
posture is reached by the same cause as the goal, and a robot that brakes already may lean as it likes."""


def rollout_record(run: RecordedRun) -> RolloutRecord:
    """The robot with the joints that were measured, where the estimate had it, and the object where it was believed.

    A frame for each moment. A run in which the robot stood still because its goal was reached is a success, one in
    which the guard braked because the robot fell, before that, is a fall. Changes of mode and faults are its events.
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
        events=shown_events(run.events),
    )


def outcome_of(events: list[tuple[float, LoggedEvent]]) -> str:
    """`success`, `fall` or `running`: nothing was decided; see `ENDINGS`."""
    before = "off"
    for _, event in events:
        if event.mode != before and (event.mode, event.cause) in ENDINGS:
            return ENDINGS[event.mode, event.cause]
        before = event.mode
    return "running"


def shown_events(events: list[tuple[float, LoggedEvent]]) -> tuple[RolloutEvent, ...]:
    """Events for a time line: a change of mode is one, any other cause a fault, the rest notes."""
    shown, before = [], "off"
    for t, event in events:
        kind = "mode" if event.mode != before else "note" if event.cause in CALM else "fault"
        text = f"{event.mode}: {event.text}" if kind == "mode" else event.text
        shown.append(RolloutEvent(time_s=t, kind=kind, text=text[:MOST_TEXT]))
        before = event.mode
    return tuple(shown)
