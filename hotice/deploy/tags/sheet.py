"""Sheets of a box's tags to print: one page of A4 for each face, at true scale, as a PDF of vectors.

Everything is drawn in millimetres from the page's lower left corner, tags where the bundle has them.
"""

from __future__ import annotations

import io
from collections.abc import Iterator
from pathlib import Path as FilePath
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hotice.deploy.tags.bundle import SHEET_M, TAG_M, TagFace, box_bundle
from hotice.deploy.tags.markers import CELLS, black_cells
from hotice.files import write_bytes
from hotice.model.objects import Box

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
PAGE_MM = (210.0, 297.0)
MIDDLE_MM = (105.0, 175.0)
"""Of the sheet on the page."""
RULER_MM, RULER_AT_MM = 100.0, (55.0, 45.0)
INCH_MM, POINT_MM = 25.4, 25.4 / 72.0
SMALL, LARGE = 9.0, 14.0
GREY = "0.4"
ID_OFF_MM = 8.2
"""From a tag to its id, off the white margin of one cell that the detector needs."""


def write_sheets(box: Box, path: str | FilePath, *, first_id: int = 0) -> FilePath:
    """A PDF with a page for each face of the box. Raises `InvalidConfig`, `MissingExtra`, `OutputError`."""
    from matplotlib.backends.backend_pdf import PdfPages

    pages, content = draw_sheets(box, first_id=first_id), io.BytesIO()
    with PdfPages(content, metadata={"Title": f"Tags of a {size_mm(box)}", "CreationDate": None}) as pdf:
        for page in pages:
            pdf.savefig(page)
    return write_bytes(path, content.getvalue())


def draw_sheets(box: Box, *, first_id: int = 0) -> list[Figure]:
    """The same pages, as figures of 210 × 297 mm. Raises `InvalidConfig` or `MissingExtra`."""
    return [draw_sheet(face, size_mm(box)) for face in box_bundle(box, first_id=first_id).faces]


def size_mm(box: Box) -> str:
    """A box in words."""
    return "box of " + " × ".join(f"{1e3 * v:g}" for v in box.size_m) + " mm"


def on_page_mm(face: TagFace, points_O: ArrayLike) -> Array:
    """Points of a face (..., 3) [m] -> their places on the page, (..., 2) [mm] right and up from its corner."""
    flat = (np.asarray(points_O, dtype=float) - face.middle_O) @ np.stack([face.right_O, face.up_O]).T
    return 1e3 * flat + MIDDLE_MM


def draw_sheet(face: TagFace, title: str) -> Figure:
    """One page. Raises `MissingExtra`."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(PAGE_MM[0] / INCH_MM, PAGE_MM[1] / INCH_MM), facecolor="white")
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0), xlim=(0.0, PAGE_MM[0]), ylim=(0.0, PAGE_MM[1]))
    axes.set_axis_off()
    for tag, corners_O in zip(face.ids, face.corners_O(), strict=True):
        _draw_tag(axes, tag, on_page_mm(face, corners_O))
    _draw_cut(axes, face)
    _draw_arrow(axes)
    _draw_words(axes, face, title)
    _draw_ruler(axes)
    return figure


def _draw_tag(axes: Axes, tag: int, corners: Array) -> None:
    """One path for all black cells: between two paths a fine light line would be seen."""
    top_left, cell = corners[0], 1e3 * TAG_M / CELLS
    rows = []
    for row, first, last in _runs(black_cells(tag)):
        left, right = top_left[0] + cell * first, top_left[0] + cell * last
        upper, lower = top_left[1] - cell * row, top_left[1] - cell * (row + 1)
        rows.append([(left, upper), (right, upper), (right, lower), (left, lower), (left, upper)])
    _fill(axes, rows)
    x, y = corners.mean(axis=0)
    outside = 0.5e3 * TAG_M + ID_OFF_MM
    below = y < MIDDLE_MM[1]
    axes.text(x, y - outside if below else y + outside, f"id {tag}", size=6.0, color=GREY, ha="center", va="center")


def _runs(black: NDArray[np.bool_]) -> Iterator[tuple[int, int, int]]:
    """Row, first cell and the one behind the last of each run of black cells."""
    for row, cells in enumerate(black):
        edges = np.flatnonzero(np.diff(np.concatenate([[0], cells.astype(int), [0]])))
        for first, last in edges.reshape(-1, 2).tolist():
            yield row, first, last


def _fill(axes: Axes, polygons: list[list[tuple[float, float]]]) -> None:
    """Closed polygons in black, without an outline."""
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path

    path = Path.make_compound_path(*(Path(polygon, closed=True) for polygon in polygons))
    axes.add_patch(PathPatch(path, facecolor="black", linewidth=0.0, snap=False))


def _line(axes: Axes, points: list[tuple[float, float]], *, dashed: bool = False, width_mm: float = 0.2) -> None:
    x, y = zip(*points, strict=True)
    axes.plot(
        x,
        y,
        color=GREY if dashed else "black",
        linewidth=width_mm / POINT_MM,
        linestyle="--" if dashed else "-",
        snap=False,
        solid_capstyle="butt",
    )


def _draw_cut(axes: Axes, face: TagFace) -> None:
    half = 0.5e3 * SHEET_M
    x, y = MIDDLE_MM
    corners = [(x - half, y - half), (x + half, y - half), (x + half, y + half), (x - half, y + half)]
    _line(axes, [*corners, corners[0]], dashed=True)


def _draw_arrow(axes: Axes) -> None:
    """In the middle of the sheet, where it stays when it is cut out; it keeps off the tags' white margins."""
    x, y = MIDDLE_MM
    _fill(
        axes,
        [
            [
                (x - 0.5, y - 8.0),
                (x + 0.5, y - 8.0),
                (x + 0.5, y + 3.0),
                (x + 2.5, y + 3.0),
                (x, y + 8.0),
                (x - 2.5, y + 3.0),
                (x - 0.5, y + 3.0),
                (x - 0.5, y - 8.0),
            ]
        ],
    )


def _draw_words(axes: Axes, face: TagFace, title: str) -> None:
    x, y = MIDDLE_MM
    half = 0.5e3 * SHEET_M
    upper, lower = face.edges
    axes.text(x, 280.0, f"{title}: {face.name} face", size=LARGE, ha="center", va="center")
    axes.text(
        x,
        266.0,
        f"Cut along the dashed line. Glue flat, with its upper edge {1e3 * face.above_m:.0f} mm below the face's,\n"
        f"{1e3 * face.beside_m:.0f} mm from the left and the right edge; the arrow points {upper}.",
        size=SMALL,
        ha="center",
        va="center",
    )
    axes.text(x, y + half + 4.0, f"this edge: {upper}", size=SMALL, ha="center", va="center")
    axes.text(x, y - half - 4.0, f"this edge: {lower}", size=SMALL, ha="center", va="center")
    axes.text(
        x,
        25.0,
        "AprilTag 36h11, tags of 50 mm. Print at 100 %, without fitting to the page, on matt paper.",
        size=SMALL,
        ha="center",
        va="center",
    )


def _draw_ruler(axes: Axes) -> None:
    x, y = RULER_AT_MM
    _line(axes, [(x, y), (x + RULER_MM, y)])
    for tick in np.linspace(0.0, RULER_MM, 11).tolist():
        _line(axes, [(x + tick, y), (x + tick, y + (5.0 if tick in (0.0, RULER_MM) else 3.0))])
    axes.text(
        x + 0.5 * RULER_MM,
        y - 5.0,
        f"must measure {RULER_MM:g} mm from end to end, or the tags have another size than the robot believes",
        size=SMALL,
        ha="center",
        va="center",
    )
