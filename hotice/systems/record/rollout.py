"""Record of what happened in a station, as a rollout, and how it ended."""

# pydrake's stubs type arrays as numpy does not:
# pyright: reportArgumentType=false

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import Context

from hotice.model import builder as models
from hotice.model.moving.mocap import place_moving
from hotice.policy.guidance import FieldReading
from hotice.policy.percept import NUM_SGF, Percept
from hotice.replay import RolloutRecord
from hotice.replay.events import RolloutEvent
from hotice.systems.hand_over.mode_selector import MODES
from hotice.systems.logs import SignalLog, read_logs
from hotice.systems.signals import NQ
from hotice.task.judge import Judge
from hotice.task.rules import MOVES_M_S, STANDS_S, arrived, walked_into

if TYPE_CHECKING:
    from hotice.systems.station.make import Station

Array = NDArray[np.float64]


def to_record(
    station: Station, context: Context, outcome: str | None = None, policy: str | None = None
) -> RolloutRecord:
    """The logged rollout as the project's record.

    `outcome`: as in `hotice.task.rules.OUTCOMES`, default: judged; `policy`: what acted, default the controller's
    name. Raises `NotAvailable` for a station that does not log.
    """
    logs = read_logs(station, context)
    state = logs["state_adaptor.robot_state"]
    # of the scene, without a table that the object is picked up from and must touch
    model = models.build_model(station.carry.carried, station.scene, joints=29, floor=False)
    percepts = [Percept(row) for row in logs["sensor_model.percept"].value]
    readings = [FieldReading(row) for row in logs["guidance_field.guidance"].value]
    time_s, qpos = state.time_s, state.value[:, :NQ]
    if station.pick is not None:
        first = _carried_from(logs["pickup.phase"], len(qpos))
        time_s, qpos = time_s[first:], qpos[first:]
    return RolloutRecord.from_states(
        model,
        state.value[:, :NQ],
        scene=station.world,
        carried=station.carry.carried,
        time_s=state.time_s,
        outcome=outcome or judge(station, time_s, qpos),
        policy=policy or station.controller_name,
        arrow_pos_W=np.stack([np.concatenate([p.p_WK, p.p_WOK]) for p in percepts]),
        arrow_force_W=np.stack([r.force_W for r in readings]),
        arrow_is_ogf=np.arange(len(readings[0].force_W)) >= NUM_SGF,
        events=_phases(logs),
    )


def _phases(logs: Mapping[str, SignalLog]) -> Iterator[RolloutEvent]:
    """Changes of who commands, and of a pick-up's phase, as events."""
    from hotice.control.pickup import PHASES
    from hotice.control.putdown import PUT_DOWN_PHASES

    of = (
        ("pickup.phase", "note", PHASES),
        ("mode_selector.mode", "mode", MODES),
        ("putdown.phase", "note", PUT_DOWN_PHASES),
    )
    for name, kind, words in of:
        if name in logs:
            value = logs[name].value[:, 0].astype(int)
            for row in np.flatnonzero(np.diff(value, prepend=-1)):
                if value[row] >= 0:
                    yield RolloutEvent(time_s=float(logs[name].time_s[row]), kind=kind, text=words[value[row]])


def _carried_from(phase: SignalLog, rows: int) -> int:
    """First row at which a pick-up holds the object in the carry state; `rows` when it never does."""
    from hotice.control.pickup import PHASES

    held = np.flatnonzero(phase.value[:, 0] == PHASES.index("hold"))
    return int(held[0]) if len(held) else rows


def judge(station: Station, time_s: Array, qpos: Array) -> str:
    """Outcome of states (T, 43) at times (T,) [s], exact geometry: first of collision, fall, drop and success.

    Conditions are the task's (`hotice.task.rules`); collisions are looked for at the states given. A pick-up is judged
    from where it holds the object; one that never does has run out of time.
    """
    import mujoco

    model = models.build_model(station.carry.carried, station.scene, joints=29)
    data = mujoco.MjData(model)
    referee, moving = Judge(model), station.scene.moving
    for now_s, row in zip(time_s.tolist(), qpos, strict=True):
        data.qpos[:] = row
        place_moving(data, moving, now_s)
        mujoco.mj_forward(model, data)
        if failed := referee.failure(data):
            return failed
        if failed := referee.collision(data):
            touched = referee.met(data)
            before = qpos[np.searchsorted(time_s, now_s - STANDS_S - 1e-6)]
            met = any(o.name in touched and o.velocity_at(now_s).fastest > MOVES_M_S for o in moving)
            return "walked_into" if walked_into(met, np.linalg.norm(row[:2] - before[:2])) else failed
        if arrived(np.linalg.norm(row[:2] - station.scene.goal)):
            return "success"
    return "timeout"
