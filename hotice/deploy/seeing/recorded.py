"""A run from its log: what the runner believed at every tick, and what the guard told."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hotice.deploy.guard.faults import Cause
from hotice.deploy.guard.modes import Mode
from hotice.deploy.log.kinds import GUARD, RUNNER, LoggedEvent, decode_event, spoken
from hotice.deploy.log.reader import Entries, Log, read_log
from hotice.deploy.seeing.moments import MOMENT, complete, moment
from hotice.errors import CheckpointError, InputError, InvalidObject, InvalidScene
from hotice.model.objects import CarriedObject, object_from_dict
from hotice.model.scene import Scene
from hotice.task.policy_task import PolicyTask


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
    events: list[tuple[float, LoggedEvent]]
    """In the order of time. Without a guard's log: the changes of mode that the runner saw."""
    targets: Entries
    """Joint targets as they were given to the guard, of `hotice.deploy.slot.records.TARGETS`."""


def read_run(folder: str | Path) -> RecordedRun:
    """A run from the folder of its log; that of the runner is needed.

    Raises:
        InputError: there is no log of a runner, it lacks what is shown, or nothing was ever believed.
    """
    runner = read_log(folder, RUNNER)
    guarded = any(Path(folder).glob(f"{GUARD}-*.log"))
    about = _about(runner.about, folder)
    moments = _moments(runner, folder)
    events = _told(read_log(folder, GUARD)) if guarded else _seen(_entries(runner, "status", folder))
    return RecordedRun(**about, moments=moments, events=events, targets=_entries(runner, "targets", folder))


def _about(said: Mapping[str, Any], folder: str | Path) -> dict[str, Any]:
    try:
        scene, carried = Scene.from_dict(said["scene"]), object_from_dict(said["carried"])
        task = PolicyTask.from_meta(said["task"], str(said["policy"]))
    except KeyError as missing:
        raise InputError(f"{folder}: the runner's log does not say its {missing.args[0]}") from None
    except (InvalidScene, InvalidObject, CheckpointError) as error:
        raise InputError(f"{folder}: the runner's log says what is not possible: {error}") from None
    return {"scene": scene, "carried": carried, "policy": str(said["policy"]), "object_field": task.object_field}


def _entries(log: Log, kind: str, folder: str | Path) -> Entries:
    if kind not in log.entries:
        raise InputError(f"{folder}: the log of {log.writer!r} has no entries of {kind!r}")
    return log.entries[kind]


def _moments(log: Log, folder: str | Path) -> np.ndarray:
    believed, reading = _entries(log, "estimate", folder), _entries(log, "reading", folder)
    status, lateness = _entries(log, "status", folder), _entries(log, "lateness", folder)
    found = []
    for t, record in zip(believed.time_s, believed.records, strict=True):
        i = np.searchsorted(status.time_s, t, side="right") - 1
        if i < 0 or found and t <= found[-1]["time_s"]:
            continue
        late, read = _at(lateness, t), _at(reading, t)
        late_s = 0.0 if late is None else float(late["late_s"])
        found.append(moment(status.records[i], record, read, time_s=float(t), late_s=late_s))
    moments = np.array(found, MOMENT)
    moments = moments[complete(moments)]
    if not len(moments):
        raise InputError(f"{folder}: the runner never knew where it was: there is nothing to show")
    return moments


def _at(entries: Entries, time_s: float) -> Any:
    """The entry of exactly this time, None if there is none."""
    i = int(np.searchsorted(entries.time_s, time_s))
    return entries.records[i] if i < len(entries.time_s) and entries.time_s[i] == time_s else None


def _told(log: Log) -> list[tuple[float, LoggedEvent]]:
    told = log.entries.get("event")
    if told is None:
        return []
    events = [(float(t), decode_event(entry)) for t, entry in zip(told.time_s, told.records, strict=True)]
    return sorted(events, key=lambda event: event[0])


def _seen(status: Entries) -> list[tuple[float, LoggedEvent]]:
    events, before = [], None
    for t, record in zip(status.time_s, status.records, strict=True):
        number = int(record["mode"])
        if number != before:
            mode, cause = named(Mode, number), named(Cause, int(record["cause"]))
            events.append((float(t), LoggedEvent(mode, cause, cause)))
        before = number
    return events


def named(kind: type[Mode] | type[Cause], number: int) -> str:
    """Name of a mode or cause as it is shown; that of a later version by its number."""
    return spoken(kind(number)) if number in set(kind) else f"{kind.__name__.lower()} {number}"
