"""Pictures of rollouts: an overview from above and from the side, and a film strip of one rollout."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from numpy.typing import NDArray

from hotice.errors import HoticeError
from hotice.files import write_bytes
from hotice.replay.html import describe
from hotice.replay.palette import (
    CATEGORY_COLORS,
    FAILURE_COLOR,
    GOAL_COLOR,
    OBJECT_COLOR,
    OGF_COLOR,
    OTHER_COLOR,
    OUTCOME_COLORS,
    ROOT_COLOR,
    SGF_COLOR,
)
from hotice.replay.rollout import RolloutRecord
from hotice.replay.solids import obstacle_geom, obstacle_triangles, outline, placed, triangles
from hotice.task.rules import GOAL_M

Array = NDArray[np.float64]
ARROW_M, FIELD_SCALE = 0.3, 0.6  # a field of strength FIELD_SCALE is drawn at 63 % of ARROW_M
LIGHT_W = np.array([-0.35, -0.55, 0.76])


def write_overview(records: Sequence[RolloutRecord], path: str | Path, *, ghosts: int = 5, arrows: bool = True) -> Path:
    """Writes a PNG with one row per rollout: seen from above and from the side (-y).

    Args:
        records: the rollouts.
        path: the .png file.
        ghosts: snapshots of the robot per row, evenly spaced in time, pale to dark.
        arrows: draws the guidance arrows of every snapshot.

    Raises:
        OutputError: `path` cannot be written.
        HoticeError: there is no record, or no snapshot is asked for.
    """
    if not records or ghosts < 1:
        raise HoticeError(f"{len(records)} rollouts with {ghosts} snapshots: at least one of each is needed")
    shape = _row_shape(records[0])
    figure = Figure(figsize=(15.0, 15.0 * shape[2] * len(records) + 0.55), dpi=110, layout="constrained")
    FigureCanvasAgg(figure)
    rows = figure.subplots(len(records), 2, squeeze=False, width_ratios=shape[:2])
    for (top, side), record in zip(rows, records, strict=True):
        for axes, plane, depth in ((top, [0, 1], 2), (side, [0, 2], 1)):
            _draw_view(axes, record, plane, depth, ghosts, arrows)
        top.set_ylabel("y [m]")
        side.set_ylabel("z [m]")
        top.set_title(f"{record.scene.name}   ({record.policy}, {describe(record.carried)})", loc="left", fontsize=11)
        ending = f"{record.outcome.replace('_', ' ')} at {record.time_s[-1] - record.time_s[0]:.2f} s, "
        ending += f"{record.distance_m:.2f} m from the goal"
        color = OUTCOME_COLORS.get(record.outcome, FAILURE_COLOR)
        side.set_title(ending, loc="right", fontsize=11, color=color, fontweight="bold")
    _legend(figure)
    return write_bytes(path, _png(figure))


def film_strip(
    record: RolloutRecord,
    path: str | Path,
    *,
    frames: int = 8,
    columns: int = 4,
    azimuth_deg: float = -55.0,
    elevation_deg: float = 12.0,
    start_s: float = 0.0,
    end_s: float = float("inf"),
    arrows: bool = True,
) -> Path:
    """Writes a PNG with 3-D views of one rollout at evenly spaced times; needs no graphics driver.

    Args:
        record: the rollout.
        path: the .png file.
        frames: number of views.
        columns: views per line.
        azimuth_deg: direction from the robot to the camera about z; 0 looks at it from +x, -90 from -y.
        elevation_deg: height of the camera above the horizontal.
        start_s: first time shown, counted from the first frame.
        end_s: last time shown.
        arrows: draws the guidance arrows.

    Raises:
        OutputError: `path` cannot be written.
        HoticeError: no frame lies between the times, or none is asked for.
    """
    time = record.time_s - record.time_s[0]
    inside = np.flatnonzero((time >= start_s) & (time <= end_s))
    if frames < 1 or columns < 1 or len(inside) == 0:
        raise HoticeError(f"{frames} frames between {start_s:g} s and {end_s:g} s of {time[-1]:g} s: none can be drawn")
    chosen = inside[np.unique(np.rint(np.linspace(0, len(inside) - 1, frames)).astype(int))]
    columns = min(columns, len(chosen))
    lines = -(-len(chosen) // columns)
    figure = Figure(figsize=(3.6 * columns, 3.9 * lines), dpi=100, layout="constrained")
    FigureCanvasAgg(figure)
    cells = figure.subplots(lines, columns, squeeze=False).ravel()
    for axes in cells:
        axes.set_axis_off()
    for axes, frame in zip(cells, chosen, strict=False):
        draw_frame(axes, record, int(frame), np.radians(azimuth_deg), np.radians(elevation_deg), arrows)
        axes.set_title(f"{time[frame]:.2f} s", fontsize=10)
    figure.suptitle(f"{record.scene.name}: {record.outcome.replace('_', ' ')} ({record.policy})", fontsize=12)
    return write_bytes(path, _png(figure))


# ---- overview --------------------------------------------------------------------------------------------------------


def _row_shape(record: RolloutRecord) -> tuple[float, float, float]:
    """Relative widths of the two views, and a row's height as a share of the picture's width."""
    width, depth, height = np.subtract(record.scene.bounds_m[1], record.scene.bounds_m[0])
    return width / depth, width / height, 1.0 / (width / depth + width / height) + 0.022


def _draw_view(axes: Axes, record: RolloutRecord, plane: list[int], depth: int, ghosts: int, arrows: bool) -> None:
    low, high = np.array(record.scene.bounds_m)
    top_view = depth == 2
    for moving in record.scene.obstacles:
        obstacle = moving.at(float(record.time_s[-1]))
        vertices, faces = obstacle_triangles(obstacle)
        points = placed(vertices, np.array(obstacle.position_m), np.array(obstacle.quaternion_wxyz))[:, plane]
        hollow = obstacle_geom(obstacle)[0] == "mesh"
        polygons = list(points[faces]) if hollow else [outline(points)]
        color = CATEGORY_COLORS.get(obstacle.category, OTHER_COLOR)
        overhead = top_view and obstacle.category == "overhead"
        axes.add_collection(
            PolyCollection(
                polygons,
                facecolor=(*to_rgb(color), 0.35 if overhead else 0.8),
                zorder=90 if overhead else 5,
                edgecolor="none" if hollow else color,
                linewidth=1.0,
            )
        )
        if moving.motion is not None:
            course = np.array([moving.at(float(time_s)).position_m for time_s in record.time_s])
            axes.plot(*course[:, plane].T, color=color, linewidth=1.2, linestyle=":", zorder=6)
    frames = np.unique(np.rint(np.linspace(0, len(record.time_s) - 1, ghosts)).astype(int))
    for n, frame in enumerate(frames):
        age = 0.72 * (1.0 - n / max(len(frames) - 1, 1)) if len(frames) > 1 else 0.0
        _draw_ghost(axes, record, int(frame), plane, depth, age, 20 + 4 * n)
        if arrows:
            _draw_arrows(axes, record, int(frame), plane, 22 + 4 * n)
    axes.plot(*record.root_pos_W[:, plane].T, color=ROOT_COLOR, linewidth=1.4, zorder=80)
    axes.plot(*record.object_pos_W[:, plane].T, color=OBJECT_COLOR, linewidth=1.4, zorder=81)
    goal = record.scene.goal
    if top_view:
        axes.add_patch(Circle(goal, GOAL_M, fill=False, edgecolor=GOAL_COLOR, linewidth=2, zorder=95))
    else:
        axes.plot([goal[0]] * 2, [0, 0.75], color=GOAL_COLOR, linewidth=2, zorder=95)
        axes.axhline(0.0, color="#475569", linewidth=1.0, zorder=4)
    axes.plot(goal[0], goal[1] if top_view else 0.75, marker="o", color=GOAL_COLOR, markersize=6, zorder=96)
    axes.set_xlim(low[0] - 0.02, high[0] + 0.13)
    axes.set_ylim(low[plane[1]] - (0.0 if top_view else 0.03), high[plane[1]])
    axes.set_aspect("equal")
    axes.set_facecolor("#f6f8fa")
    axes.grid(color="#dbe2ea", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.tick_params(labelsize=8, colors="#475569")
    axes.set_xlabel("x [m]", fontsize=9)


def _draw_ghost(
    axes: Axes, record: RolloutRecord, frame: int, plane: list[int], depth: int, age: float, zorder: float
) -> None:
    """Outlines of every solid, far ones first; `age` 0 draws full colours, 1 white."""
    height = record.geom_pos_W[frame, :, depth]
    polygons, colors = [], []
    for g in np.argsort(height if depth == 2 else -height):
        points = placed(_solid(record, g, 16)[0], record.geom_pos_W[frame, g], record.geom_quat_W[frame, g])
        polygons.append(outline(points[:, plane]))
        colors.append(record.display_rgba[g, :3] * (1 - age) + age)
    edges = [0.62 * c + 0.38 * age for c in colors]
    axes.add_collection(PolyCollection(polygons, facecolors=colors, edgecolors=edges, linewidths=0.7, zorder=zorder))


def _draw_arrows(axes: Axes, record: RolloutRecord, frame: int, plane: list[int], zorder: float) -> None:
    start, shaft = arrows_of(record, frame)
    for is_ogf, color in ((False, SGF_COLOR), (True, OGF_COLOR)):
        rows = record.arrow_is_ogf == is_ogf
        if rows.any():
            axes.quiver(
                *start[rows][:, plane].T,
                *shaft[rows][:, plane].T,
                color=color,
                angles="xy",
                scale_units="xy",
                scale=1.0,
                width=0.0022,
                headwidth=4.0,
                headlength=5.0,
                zorder=zorder,
                alpha=0.85,
            )


def _legend(figure: Figure) -> None:
    from matplotlib.lines import Line2D

    entries = {
        "root": ROOT_COLOR,
        "object": OBJECT_COLOR,
        "goal": GOAL_COLOR,
        "SGF": SGF_COLOR,
        "OGF": OGF_COLOR,
        **{f"{name} obstacle": color for name, color in CATEGORY_COLORS.items()},
    }
    handles = [Line2D([], [], color=color, linewidth=3, label=name) for name, color in entries.items()]
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), frameon=False, fontsize=9)


# ---- film strip ------------------------------------------------------------------------------------------------------


def draw_frame(axes: Axes, record: RolloutRecord, frame: int, azimuth: float, elevation: float, arrows: bool) -> None:
    """One perspective view: triangles are shaded, sorted by distance and painted far to near; angles [rad]."""
    # A little ahead of the pelvis and at a fixed height, so that a crouch shows as one.
    look_at = np.array([*record.root_pos_W[frame, :2], 0.66]) + [0.1, 0.0, 0.0]
    back = np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
    eye = look_at + 3.2 * back
    right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    R_CW = np.stack([right, np.cross(back, right), back])

    def project(points_W: Array) -> tuple[Array, Array]:
        p_C = (points_W - eye) @ R_CW.T
        distance = np.maximum(-p_C[..., 2], 0.05)
        return p_C[..., :2] / distance[..., None], distance

    corners, colors = [], []
    for g in range(len(record.geom_names)):
        vertices, faces = _solid(record, g, 20)
        points = placed(vertices, record.geom_pos_W[frame, g], record.geom_quat_W[frame, g])
        corners.append(points[faces])
        colors.append(np.tile(record.display_rgba[g], (len(faces), 1)))
    for moving in record.scene.obstacles:
        obstacle = moving.at(float(record.time_s[frame]))
        vertices, faces = obstacle_triangles(obstacle)
        points = placed(vertices, np.array(obstacle.position_m), np.array(obstacle.quaternion_wxyz))
        # Painter's algorithm: triangles are sorted by their mean distance, which only works for small ones.
        pieces = _subdivided(points[faces], 0.2)
        hiding = (pieces.mean(axis=1) - record.root_pos_W[frame]) @ back > 0.25  # in front of the robot: see-through
        rgb = np.broadcast_to(to_rgb(CATEGORY_COLORS.get(obstacle.category, OTHER_COLOR)), (len(pieces), 3))
        corners.append(pieces)
        colors.append(np.column_stack([rgb, np.where(hiding, 0.4, 1.0)]))
    corner, color = np.concatenate(corners), np.concatenate(colors)
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    facing = np.einsum("ij,ij->i", normal, eye - corner.mean(axis=1)) > 0
    # Nothing within 0.3 m of the eye or behind it.
    near = ((corner - eye) @ back).max(axis=1) < -0.3
    corner, color, normal = corner[facing & near], color[facing & near], normal[facing & near]
    shade = 0.62 + 0.45 * np.clip(normal @ LIGHT_W, -0.6, 1.0)
    color = np.column_stack([np.clip(color[:, :3] * shade[:, None] + 0.06, 0, 1), color[:, 3]])
    flat, distance = project(corner)
    order = np.argsort(-distance.mean(axis=1))
    opaque = color[order, 3] == 1
    _draw_floor(axes, record, project, look_at)
    axes.add_collection(
        PolyCollection(
            list(flat[order]),
            facecolors=color[order],
            edgecolors=color[order] * opaque[:, None],
            linewidths=0.3,
            zorder=5,
        )
    )
    if arrows and len(record.arrow_is_ogf):
        start, shaft = arrows_of(record, frame)
        tail, tip = project(start)[0], project(start + shaft)[0]
        colors_of = [OGF_COLOR if is_ogf else SGF_COLOR for is_ogf in record.arrow_is_ogf]
        axes.quiver(
            *tail.T, *(tip - tail).T, color=colors_of, angles="xy", scale_units="xy", scale=1.0, width=0.006, zorder=9
        )
    axes.set_xlim(-0.225, 0.225)
    axes.set_ylim(-0.245, 0.205)
    axes.set_aspect("equal")


def _draw_floor(axes: Axes, record: RolloutRecord, project, look_at: Array) -> None:
    """Lines every 0.25 m around the robot, the goal's ring and its post."""
    centre = np.round(look_at[:2] / 0.25) * 0.25
    span = np.linspace(-1.5, 1.5, 25)
    for offset in np.arange(-1.5, 1.51, 0.25):
        for line in (np.column_stack([np.full(25, offset), span]), np.column_stack([span, np.full(25, offset)])):
            points = np.column_stack([line + centre, np.zeros(25)])
            axes.plot(*project(points)[0].T, color="#cbd5e1", linewidth=0.6, zorder=1)
    turn = np.linspace(0, 2 * np.pi, 40)
    circle = np.array(record.scene.goal) + GOAL_M * np.column_stack([np.cos(turn), np.sin(turn)])
    ring = np.column_stack([circle, np.zeros(40)])
    axes.plot(*project(ring)[0].T, color=GOAL_COLOR, linewidth=1.6, zorder=2)
    post = np.array([[*record.scene.goal, 0.0], [*record.scene.goal, 0.75]])
    axes.plot(*project(post)[0].T, color=GOAL_COLOR, linewidth=1.0, zorder=2)


def _subdivided(corner: Array, longest: float) -> Array:
    """Splits triangles (F, 3, 3) at their edges' midpoints until no edge exceeds `longest`, so that they sort well."""
    done = []
    for _ in range(6):
        edge = np.linalg.norm(corner - np.roll(corner, 1, axis=1), axis=2).max(axis=1)
        done.append(corner[edge <= longest])
        a, b, c = np.moveaxis(corner[edge > longest], 1, 0)
        ab, bc, ca = 0.5 * (a + b), 0.5 * (b + c), 0.5 * (c + a)
        corner = np.concatenate([np.stack(t, axis=1) for t in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))])
    return np.concatenate([*done, corner])


# ---- shared ----------------------------------------------------------------------------------------------------------


def _solid(record: RolloutRecord, g: int, segments: int) -> tuple[Array, NDArray[np.int64]]:
    return triangles(record.geom_types[g], tuple(record.geom_sizes[g].tolist()), segments)


def arrows_of(record: RolloutRecord, frame: int) -> tuple[Array, Array]:
    """Starts and shafts of the guidance arrows, (K, 3) each [m]; length grows with strength and stays below ARROW_M."""
    force = record.arrow_force_W[frame]
    strength = np.linalg.norm(force, axis=-1, keepdims=True)
    # Saturates: beside walls a field may be many times as strong as in the open.
    length = ARROW_M * -np.expm1(-strength / FIELD_SCALE)
    return record.arrow_pos_W[frame], force / np.maximum(strength, 1e-12) * length


def _png(figure: Figure) -> bytes:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png")
    return buffer.getvalue()
