"""Logs of every signal of a diagram."""

# pydrake's stubs type arrays as numpy does not:
# pyright: reportArgumentType=false

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import Context, Diagram, DiagramBuilder, PortDataType
from pydrake.systems.primitives import LogVectorOutput, VectorLogSink

from hotice.errors import NotAvailable

Array = NDArray[np.floating]
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


def read_logs(station: Diagram, context: Context) -> dict[str, SignalLog]:
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
