"""A run from its log: what the runner believed at every tick, and what the guard told."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from hotice.deploy.guard.faults import Cause
from hotice.deploy.guard.modes import Mode
from hotice.deploy.log.reader import Entries, Log, read_log
from hotice.deploy.recording.replay import NAME, AroundAgain, prepared_again
from hotice.deploy.runner.estimator import Estimate
from hotice.deploy.seeing.moments import MOMENT, complete, moment, named, percept_of, spoken
from hotice.documents import parse_json
from hotice.errors import InputError
from hotice.fields.hod_pf import HodPf
from hotice.fields.moving.momentary import MomentaryPf
from hotice.model.objects import CarriedObject
from hotice.model.scene import Scene
from hotice.policy import PolicyTask, read_fields
from hotice.policy.guidance import FieldReading
from hotice.policy.percept import Percept

GUARD = "guard"
"""Name of the guard's log."""


class LoggedEvent(NamedTuple):
    """What the guard told: mode and cause as they are shown (`pick up`, `box unseen`), and its text."""

    mode: str
    cause: str
    text: str


@dataclass(frozen=True, kw_only=True, eq=False)
class RecordedRun:
    """One run of T ticks at which something was believed; all times on the monotonic clock of that machine [s]."""

    scene: Scene
    carried: CarriedObject
    policy: str
    object_field: str
    """What hands and object read: `PolicyTask.object_field`."""
    moments: np.ndarray
    """(T,) of `MOMENT`, time growing."""
    readings: list[FieldReading]
    """T, what the fields say there. In carry the policy reads them; in the other modes it is made to stand."""
    events: list[tuple[float, LoggedEvent]]
    """In the order of time. Without a guard's log: the changes of mode that the runner saw."""
    targets: Entries
    """Joint targets as they were given to the guard, of `hotice.deploy.slot.records.TARGETS`."""


def read_run(folder: str | Path, say: Callable[[str], None] = lambda text: None) -> RecordedRun:
    """A run from the folder of its log; that of the runner is needed. `say` is told what goes on.

    Raises:
        HoticeError: there is no log of a runner, its policy or scene is another one now, or nothing was ever believed.
    """
    runner = read_log(folder, NAME)
    options, made = prepared_again(runner, folder, say)
    task = PolicyTask.from_meta(made.policy.meta, made.policy.name)
    again = AroundAgain(runner, options, made)
    moments, fields = _moments(runner, task.control_dt_s, again, made.pf)
    if not len(moments):
        raise InputError(f"{folder}: the runner never knew where it was: there is nothing to show")
    guarded = any(Path(folder).glob(f"{GUARD}-*.log"))
    return RecordedRun(
        scene=made.pf.scene,
        carried=made.carry.carried,
        policy=options.policy,
        object_field=task.object_field,
        moments=moments,
        readings=[read_fields(pf, percept_of(each), task) for pf, each in zip(fields, moments, strict=True)],
        events=_told(read_log(folder, GUARD)) if guarded else _seen(runner.entries["status"]),
        targets=runner.entries["targets"],
    )


Fields = HodPf | MomentaryPf


def _moments(log: Log, period_s: float, again: AroundAgain, still: HodPf) -> tuple[np.ndarray, list[Fields]]:
    """Moments at which a robot can be shown, and the fields that the runner had then."""
    believed, status = log.entries["estimate"], log.entries["status"]
    ticks_s = np.unique(np.concatenate([log.entries[kind].time_s for kind in ("status", "estimate", "targets")]))
    late_s = np.diff(ticks_s, prepend=ticks_s[:1] - period_s) - period_s
    found, fields, came = [], [], deque(again.times_s)
    for t, record in zip(believed.time_s, believed.records, strict=True):
        i = int(np.searchsorted(status.time_s, t))
        if i == len(status.time_s) or status.time_s[i] != t:
            # the status of this tick was dropped
            continue
        estimate = Estimate(
            percept=Percept(record["percept"]),
            pose_age_s=float(record["pose_age_s"]),
            box_age_s=float(record["box_age_s"]),
            disputed=bool(record["disputed"]),
            pose_verdict="",
            box_verdict="",
        )
        late = max(0.0, float(late_s[np.searchsorted(ticks_s, t)]))
        around = again.around
        if around is not None:
            while came and came[0] <= t:
                again.tell(came[0])
                around.look(came.popleft())
            around.look(float(t))
        fields.append(still if around is None else around.fields)
        found.append(moment(status.records[i], estimate, time_s=float(t), late_s=late, around=around))
    moments = np.array(found, MOMENT)
    shown = complete(moments)
    return moments[shown], [pf for pf, there in zip(fields, shown.tolist(), strict=True) if there]


def _told(log: Log) -> list[tuple[float, LoggedEvent]]:
    told = log.entries.get("event")
    if told is None:
        return []
    events = [(float(t), _event(entry)) for t, entry in zip(told.time_s, told.records, strict=True)]
    return sorted(events, key=lambda event: event[0])


def _event(entry: bytes) -> LoggedEvent:
    said = parse_json("an event of the log", entry)
    if not isinstance(said, dict) or {type(said.get(key)) for key in LoggedEvent._fields} != {str}:
        raise InputError(
            f"an event of the log is {entry[:80]!r}: the texts {', '.join(LoggedEvent._fields)} are needed"
        )
    return LoggedEvent(spoken(said["mode"]), spoken(said["cause"]), said["text"])


def _seen(status: Entries) -> list[tuple[float, LoggedEvent]]:
    events, before = [], None
    for t, record in zip(status.time_s, status.records, strict=True):
        number = int(record["mode"])
        if number != before:
            mode, cause = named(Mode, number), named(Cause, int(record["cause"]))
            events.append((float(t), LoggedEvent(mode, cause, cause)))
        before = number
    return events
