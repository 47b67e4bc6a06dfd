"""What happened in a station: logs of every signal, a rollout record, pages and pictures to look at."""

# pydrake's stubs type arrays as numpy does not:
# pyright: reportArgumentType=false

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import Context, DiagramBuilder, PortDataType
from pydrake.systems.primitives import LogVectorOutput, VectorLogSink

from hotice.errors import NotAvailable
from hotice.files import write_text
from hotice.model import builder as models
from hotice.policy.guidance import FieldReading
from hotice.policy.percept import NUM_SGF, Percept
from hotice.replay import RolloutRecord
from hotice.systems.signals import NQ
from hotice.task.judge import Judge
from hotice.task.rules import arrived

if TYPE_CHECKING:
    from hotice.systems.station.make import Station

Array = NDArray[np.float64]
PREFIX = "log/"


@dataclass(frozen=True, kw_only=True, eq=False)
class SignalLog:
    """One signal: time_s (T,) [s], value (T, n); units and frames are those of the port."""

    time_s: Array
    value: Array


def add_loggers(builder: DiagramBuilder, period_s: float) -> None:
    """Logs every vector output of the systems that are there, under `log/<system>.<port>`."""
    for system in builder.GetSystems():
        for i in range(system.num_output_ports()):
            port = system.get_output_port(i)
            if port.get_data_type() == PortDataType.kVectorValued and port.size():
                sink = LogVectorOutput(port, builder, period_s)
                sink.set_name(f"{PREFIX}{system.get_name()}.{port.get_name()}")


def read_logs(station: Station, context: Context) -> dict[str, SignalLog]:
    """Every logged signal, by `<system>.<port>`. Raises `NotAvailable` for a station that does not log."""
    logs = {}
    for system in station.GetSystems():
        if isinstance(system, VectorLogSink):
            log = system.FindLog(context)
            name = system.get_name().removeprefix(PREFIX)
            logs[name] = SignalLog(time_s=log.sample_times().copy(), value=log.data().T.copy())
    if not logs:
        raise NotAvailable("this station does not log: make it from a configuration with log_hz, 50 say")
    return logs


def to_record(
    station: Station, context: Context, outcome: str | None = None, policy: str | None = None
) -> RolloutRecord:
    """The logged rollout as the project's record.

    `outcome`: as in `hotice.task.rules.OUTCOMES`, default: judged; `policy`: what acted, default the controller's
    name. Raises `NotAvailable` for a station that does not log.
    """
    logs = read_logs(station, context)
    state = logs["state_adaptor.robot_state"]
    model = models.build_model(station.carry.carried, joints=29, floor=False)
    percepts = [Percept(row) for row in logs["sensor_model.percept"].value]
    readings = [FieldReading(row) for row in logs["guidance_field.guidance"].value]
    qpos = state.value[:, :NQ]
    if station.pick is not None:
        qpos = qpos[_carried_from(logs["pickup.phase"], len(qpos)) :]
    return RolloutRecord.from_states(
        model,
        state.value[:, :NQ],
        scene=station.world,
        carried=station.carry.carried,
        time_s=state.time_s,
        outcome=outcome or judge(station, qpos),
        policy=policy or station.controller_name,
        arrow_pos_W=np.stack([np.concatenate([p.p_WK, p.p_WOK]) for p in percepts]),
        arrow_force_W=np.stack([r.force_W for r in readings]),
        arrow_is_ogf=np.arange(len(readings[0].force_W)) >= NUM_SGF,
    )


def _carried_from(phase: SignalLog, rows: int) -> int:
    """First row at which a pick-up holds the object in the carry state; `rows` when it never does."""
    from hotice.control.pickup import PHASES

    held = np.flatnonzero(phase.value[:, 0] == PHASES.index("hold"))
    return int(held[0]) if len(held) else rows


def judge(station: Station, qpos: Array) -> str:
    """How a rollout of states (T, 43) ended, exact geometry: the first of collision, fall, drop and success that
    happens.

    Conditions are the task's (`hotice.task.rules`); collisions are looked for at the states given. A pick-up is judged
    from where it holds the object; one that never does has run out of time.
    """
    import mujoco

    model = models.build_model(station.carry.carried, station.scene, joints=29)
    data = mujoco.MjData(model)
    referee = Judge(model)
    for row in qpos:
        data.qpos[:] = row
        mujoco.mj_forward(model, data)
        if failed := referee.failure(data) or referee.collision(data):
            return failed
        if arrived(np.linalg.norm(row[:2] - station.scene.goal)):
            return "success"
    return "timeout"


def write_html(meshcat: Any, path: str | Path) -> Path:
    """Writes what a Meshcat shows, its recording included, as one page that needs no server. Raises `OutputError`."""
    return write_text(path, meshcat.StaticHtml())


def write_diagram(station: Station, path: str | Path) -> Path:
    """Draws the station's systems and connections: .dot text for Graphviz, or a .png, .svg or .pdf picture.

    Raises `OutputError`.
    """
    path = Path(path)
    if path.suffix == ".dot":
        return write_text(path, station.GetGraphvizString(max_depth=1))
    from hotice.systems.record.picture import draw_diagram

    return draw_diagram(station, path)


def wires(station: Station) -> list[tuple[str, str, str, str]]:
    """Connections as (system, output port, system, input port), loggers left out."""
    found = []
    connections: Mapping[Any, Any] = station.connection_map()
    for (target, into), (source, out) in connections.items():
        if isinstance(target, VectorLogSink):
            continue
        ports = source.get_output_port(int(out)).get_name(), target.get_input_port(int(into)).get_name()
        found.append((source.get_name(), ports[0], target.get_name(), ports[1]))
    return found
