"""Building diagrams that are whole: a port left open is found before anything runs."""

from __future__ import annotations

from pydrake.systems.framework import Diagram, DiagramBuilder, InputPort, LeafSystem, OutputPort, System

from hotice.errors import InvalidStation

OPTIONAL_PORTS = frozenset(
    {"active", "answer", "damped", "footsteps", "sources", "status", "carry_status", "pickup_status", "walk_status"}
    | {"watched_guidance", "watched_percept"}
)
"""Input ports that may stay open: their systems say what happens then."""


def connect(builder: DiagramBuilder, source: System, output: str, target: System, port: str) -> None:
    """Joins two ports by name. Raises `InvalidStation` for an unknown port, another size or a port already joined."""
    out, into = _output(source, output), _input(target, port)
    if out.size() != into.size():
        raise InvalidStation(
            f"port {output!r} of {source.get_name()!r} has {out.size()} numbers, port {port!r} of "
            f"{target.get_name()!r} needs {into.size()}"
        )
    if builder.IsConnectedOrExported(into):
        raise InvalidStation(f"input port {port!r} of {target.get_name()!r} is connected already")
    builder.Connect(out, into)


def build(builder: DiagramBuilder, into: Diagram | None = None) -> Diagram:
    """Builds the diagram (into an object of a subclass, if given). Raises `InvalidStation` naming every open port."""
    open_ports = [
        f"{port.get_name()!r} of {system.get_name()!r}"
        for system in builder.GetSystems()
        if isinstance(system, LeafSystem | Diagram) and type(system).__module__.startswith("hotice.")
        for port in map(system.get_input_port, range(system.num_input_ports()))
        if port.get_name() not in OPTIONAL_PORTS and not builder.IsConnectedOrExported(port)
    ]
    if open_ports:
        raise InvalidStation(f"input ports are not connected: {', '.join(open_ports)}")
    if into is None:
        return builder.Build()
    builder.BuildInto(into)
    return into


def _output(system: System, name: str) -> OutputPort:
    known = [system.get_output_port(i).get_name() for i in range(system.num_output_ports())]
    if name not in known:
        raise InvalidStation(f"{system.get_name()!r} has no output port {name!r}: known are {', '.join(known)}")
    return system.GetOutputPort(name)


def _input(system: System, name: str) -> InputPort:
    known = [system.get_input_port(i).get_name() for i in range(system.num_input_ports())]
    if name not in known:
        raise InvalidStation(f"{system.get_name()!r} has no input port {name!r}: known are {', '.join(known)}")
    return system.GetInputPort(name)
