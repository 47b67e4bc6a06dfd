"""A picture of a diagram: systems as boxes in columns by distance from the plant, connections as labelled arrows."""

from __future__ import annotations

import io
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from hotice.errors import OutputError
from hotice.files import write_bytes

if TYPE_CHECKING:
    from hotice.systems.station import Station

FORMATS = (".png", ".svg", ".pdf")
BOX = (1.5, 0.5)


def draw_diagram(station: Station, path: Path) -> Path:
    """Writes the picture. Raises `OutputError` for another format or a path that cannot be written."""
    if path.suffix not in FORMATS:
        raise OutputError(f"cannot write {path}: a diagram is drawn as {', '.join(FORMATS)} or written as .dot")
    from matplotlib.figure import Figure
    from matplotlib.patches import FancyBboxPatch

    from hotice.systems.recording import wires

    edges = wires(station)
    place = _layout(edges)
    columns, rows = (max(p[i] for p in place.values()) + 1 for i in range(2))
    figure = Figure(figsize=(2.6 * columns, 1.3 * rows + 1.0), layout="constrained")
    ax = figure.add_subplot()
    for source, out, target, into in edges:
        _draw_wire(ax, place[source], place[target], out if out == into else f"{out} → {into}")
    for name, (x, y) in place.items():
        corner = (2.6 * x - 0.5 * BOX[0], -1.3 * y - 0.5 * BOX[1])
        ax.add_patch(FancyBboxPatch(corner, *BOX, boxstyle="round,pad=0.08", fc="#e8eef5", ec="#41546b", zorder=3))
        ax.text(2.6 * x, -1.3 * y, name.replace("_", " "), ha="center", va="center", fontsize=10, zorder=4)
    ax.set_xlim(-1.2, 2.6 * (columns - 1) + 1.2)
    ax.set_ylim(-1.3 * (rows - 1) - 1.0, 1.4)
    ax.set_axis_off()
    buffer = io.BytesIO()
    figure.savefig(buffer, format=path.suffix[1:], dpi=110)
    return write_bytes(path, buffer.getvalue())


def _layout(edges: list[tuple[str, str, str, str]]) -> dict[str, tuple[int, int]]:
    """Column and row of each system; the column is the longest way from the plant without turning back."""
    names = sorted({name for edge in edges for name in (edge[0], edge[2])})
    column = dict.fromkeys(names, 0)
    for _ in names:
        for source, _, target, _ in edges:
            if target != "plant":
                column[target] = max(column[target], column[source] + 1)
    place, filled = {}, dict.fromkeys(column.values(), 0)
    for name in sorted(names, key=lambda n: (column[n], n)):
        place[name] = (column[name], filled[column[name]])
        filled[column[name]] += 1
    return place


def _draw_wire(ax, start: tuple[int, int], end: tuple[int, int], label: str) -> None:
    a, b = np.array([2.6 * start[0], -1.3 * start[1]]), np.array([2.6 * end[0], -1.3 * end[1]])
    back = end[0] <= start[0]
    bend = -0.25 if back else (0.0 if end[0] == start[0] + 1 else 0.18)
    ax.annotate(
        "", xy=b, xytext=a, zorder=1,
        arrowprops=dict(arrowstyle="-|>", color="#7a8798", connectionstyle=f"arc3,rad={bend}", shrinkA=38, shrinkB=38),
    )  # fmt: skip
    normal = np.array([b[1] - a[1], a[0] - b[0]]) * bend
    ax.text(*(0.5 * (a + b) + 0.5 * normal + [0.0, 0.08]), label, ha="center", fontsize=7, color="#41546b", zorder=2)
