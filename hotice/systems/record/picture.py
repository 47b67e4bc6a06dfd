"""Pictures of a station: what a Meshcat shows, as a page; its diagram, as a drawing.

Systems are boxes in columns by distance from the plant, connections labelled arrows.
"""

from __future__ import annotations

import io
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from pydrake.systems.framework import Diagram
from pydrake.systems.primitives import VectorLogSink

from hotice.errors import OutputError
from hotice.files import write_bytes, write_text
from hotice.systems.record.routing import HEIGHT, WIDTH, Wire, route

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FORMATS = (".png", ".svg", ".pdf")
INK, LINE = "#41546b", "#7a8798"
"""Colours of boxes and labels, and of wires."""


def write_station_page(meshcat: Any, path: str | Path) -> Path:
    """Writes what a Meshcat shows, its recording included, as one page that needs no server. Raises `OutputError`."""
    return write_text(path, meshcat.StaticHtml())


def write_diagram(station: Diagram, path: str | Path) -> Path:
    """Draws the station's systems and connections: .dot text for Graphviz, or a .png, .svg or .pdf picture.

    Raises `OutputError`.
    """
    path = Path(path)
    if path.suffix == ".dot":
        return write_text(path, station.GetGraphvizString(max_depth=1))
    return draw_diagram(station, path)


def wires(station: Diagram) -> list[tuple[str, str, str, str]]:
    """Connections as (system, output port, system, input port), loggers left out."""
    found = []
    connections: Mapping[Any, Any] = station.connection_map()
    for (target, into), (source, out) in connections.items():
        if isinstance(target, VectorLogSink):
            continue
        ports = source.get_output_port(int(out)).get_name(), target.get_input_port(int(into)).get_name()
        found.append((source.get_name(), ports[0], target.get_name(), ports[1]))
    return found


def draw_diagram(station: Diagram, path: Path) -> Path:
    """Writes the picture. Raises `OutputError` for another format or a path that cannot be written."""
    if path.suffix not in FORMATS:
        raise OutputError(f"cannot write {path}: a diagram is drawn as {', '.join(FORMATS)} or written as .dot")
    from matplotlib.figure import Figure
    from matplotlib.patches import FancyBboxPatch

    edges = wires(station)
    labels: dict[tuple[str, str], list[str]] = {}
    for source, out, target, into in edges:
        labels.setdefault((source, target), []).append(out if out == into else f"{out} → {into}")
    drawing = route(
        _layout([system.get_name() for system in station.GetSystems()], edges),
        {ends: ", ".join(ports) for ends, ports in labels.items()},
    )
    corners = np.array([*drawing.boxes.values(), *(point for wire in drawing.wires for point in wire.points)])
    low, high = corners.min(axis=0) - [0.6 * WIDTH, 0.4], corners.max(axis=0) + [0.6 * WIDTH, 0.4]
    figure = Figure(figsize=tuple(high - low), layout="constrained")
    ax = figure.add_subplot()
    for name, (x, y) in drawing.boxes.items():
        size = WIDTH - 0.16, HEIGHT - 0.16
        corner = (x - 0.5 * size[0], y - 0.5 * size[1])
        ax.add_patch(FancyBboxPatch(corner, *size, boxstyle="round,pad=0.08", fc="#e8eef5", ec=INK, zorder=3))
        ax.text(x, y, name.replace("_", " "), ha="center", va="center", fontsize=10, zorder=4)
    for wire in drawing.wires:
        _draw_wire(ax, wire)
    ax.set_xlim(low[0], high[0])
    ax.set_ylim(low[1], high[1])
    ax.set_axis_off()
    buffer = io.BytesIO()
    figure.savefig(buffer, format=path.suffix[1:], dpi=110)
    return write_bytes(path, buffer.getvalue())


def _layout(order: list[str], edges: list[tuple[str, str, str, str]]) -> dict[str, tuple[int, int]]:
    """Column and row of each system: the longest way from the plant along wires to systems that were added later."""
    wired = {name for edge in edges for name in (edge[0], edge[2])}
    rank = {name: i for i, name in enumerate(order) if name in wired}
    column = dict.fromkeys(rank, 0)
    for name in rank:
        for source, _, target, _ in edges:
            if source == name and rank[target] > rank[source]:
                column[target] = max(column[target], column[source] + 1)
    place, filled = {}, dict.fromkeys(column.values(), 0)
    for name in rank:
        place[name] = (column[name], filled[column[name]])
        filled[column[name]] += 1
    return place


def _draw_wire(ax: Axes, wire: Wire) -> None:
    """A line along its corners, an arrow at its end, the label on its longest part."""
    *before, last, end = wire.points
    ax.plot(*zip(*before, last, end, strict=True), color=LINE, linewidth=1.0, zorder=2, solid_joinstyle="round")
    ax.annotate("", xy=end, xytext=last, zorder=2, arrowprops=dict(arrowstyle="-|>", color=LINE, shrinkA=0, shrinkB=0))
    label = wire.label.replace(", ", "\n") if len(wire.points) == 2 else wire.label
    ax.text(
        *wire.at,
        label,
        ha="center",
        va="center",
        fontsize=7,
        color=INK,
        zorder=5,
        bbox=dict(facecolor="white", edgecolor="none", pad=0.8),
    )
