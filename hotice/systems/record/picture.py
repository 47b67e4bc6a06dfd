"""Pictures of a station: what a Meshcat shows, as a page; its diagram, as a drawing.

Systems are boxes in columns by distance from the plant, connections labelled arrows.
"""

from __future__ import annotations

import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from pydrake.systems.framework import Diagram
from pydrake.systems.primitives import VectorLogSink

from hotice.errors import OutputError
from hotice.files import write_bytes, write_text

FORMATS = (".png", ".svg", ".pdf")
BOX = (1.5, 0.5)
DX, DY = 3.1, 1.4
"""Size of a box, and from one to the next."""
AHEAD, BACK = 0.28, 0.22
"""Bend of wires that pass over systems, and of those that lead back, per length."""


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
    place = _layout([system.get_name() for system in station.GetSystems()], edges)
    columns, rows = (max(p[i] for p in place.values()) + 1 for i in range(2))
    figure = Figure(figsize=(DX * columns, DY * rows + 3.0), layout="constrained")
    ax = figure.add_subplot()
    boxes = {}
    for name, (x, y) in place.items():
        corner = (DX * x - 0.5 * BOX[0], -DY * y - 0.5 * BOX[1])
        boxes[name] = FancyBboxPatch(corner, *BOX, boxstyle="round,pad=0.08", fc="#e8eef5", ec="#41546b", zorder=3)
        ax.add_patch(boxes[name])
        ax.text(DX * x, -DY * y, name.replace("_", " "), ha="center", va="center", fontsize=10, zorder=4)
    labels: dict[tuple[str, str], list[str]] = {}
    for source, out, target, into in edges:
        labels.setdefault((source, target), []).append(out if out == into else f"{out} → {into}")
    for (source, target), ports in labels.items():
        _draw_wire(ax, place[source], place[target], (boxes[source], boxes[target]), "\n".join(ports))
    spans = [place[target][0] - place[source][0] for source, target in labels]
    above, below = 0.5 * AHEAD * DX * max(spans), 0.5 * BACK * DX * max(-min(spans), 0)
    ax.set_xlim(-1.2, DX * (columns - 1) + 1.2)
    ax.set_ylim(-max(DY * (rows - 1) + 0.6, below + 0.4), max(above, 0.0) + 0.5)
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


def _draw_wire(ax, start: tuple[int, int], end: tuple[int, int], boxes: tuple, label: str) -> None:
    """An arrow from box to box: straight to the next column, above over several, below on the way back."""
    a, b = np.array([DX * start[0], -DY * start[1]]), np.array([DX * end[0], -DY * end[1]])
    bend = 0.0 if end[0] == start[0] + 1 else -AHEAD if end[0] > start[0] else -BACK
    ax.annotate(
        "",
        xy=b,
        xytext=a,
        zorder=2,
        arrowprops=dict(
            arrowstyle="-|>", color="#7a8798", connectionstyle=f"arc3,rad={bend}", patchA=boxes[0], patchB=boxes[1]
        ),
    )
    normal = np.array([b[1] - a[1], a[0] - b[0]]) * bend
    ax.text(*(0.5 * (a + b) + 0.5 * normal + [0.0, 0.06]), label, ha="center", fontsize=7, color="#41546b", zorder=5)
