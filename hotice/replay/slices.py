"""Slices through guidance fields: force as arrows over the potential, as in the paper's comparison of SGF and OGF.

Draws into given matplotlib axes, so that a notebook or a figure of one's own decides the layout.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from hotice import checks
from hotice.checks import Range
from hotice.errors import InvalidConfig, UnknownName
from hotice.fields.descent import descend
from hotice.fields.hod_pf import GuidanceField, HodPf
from hotice.replay.palette import GOAL_COLOR, OGF_COLOR

PLANES = {"xy": (0, 1, 2), "xz": (0, 2, 1), "yz": (1, 2, 0)}
"""Axis to the right, axis up, axis the slice is normal to."""
QUANTITIES = ("potential", "geodesic_distance", "signed_distance", "force")
WALL_COLOR, INFLATED_COLOR, ARROW_COLOR = "#334155", OGF_COLOR, "#0f172a"
_CEILING = 0.98
"""Colours end at this quantile: the repulsive potential at walls would leave no shade for the rest."""


def slice_points(pf: HodPf, plane: str, at_m: float, spacing_m: float) -> NDArray[np.float64]:
    """Points in a plane of the scene at the middles of `spacing_m` cells, (rows, columns, 3) in W [m].

    Raises:
        UnknownName: `plane` is not xy, xz or yz.
        InvalidConfig: the plane misses the scene or the spacing leaves no point.
    """
    if plane not in PLANES:
        raise UnknownName("plane", plane, PLANES)
    right, up, normal = PLANES[plane]
    low, high = np.array(pf.scene.bounds_m)
    if not low[normal] <= at_m <= high[normal]:
        raise InvalidConfig(
            f"plane {plane} at {at_m} m misses the scene: {low[normal]:g} .. {high[normal]:g} m is inside"
        )
    extent_m = float((high - low)[[right, up]].min())
    checks.number("spacing_m", spacing_m, Range(above=0, most=extent_m, unit="m", note="the scene's extent"))
    points = np.empty((*(len(_middles(low[a], high[a], spacing_m)) for a in (up, right)), 3))
    points[..., right] = _middles(low[right], high[right], spacing_m)
    points[..., up] = _middles(low[up], high[up], spacing_m)[:, None]
    points[..., normal] = at_m
    return points


def draw_slice(
    axes: Axes,
    pf: HodPf,
    field: str = "sgf",
    *,
    plane: str = "xz",
    at_m: float = 0.0,
    quantity: str = "potential",
    arrows: bool = True,
    arrow_spacing_m: float = 0.08,
) -> Any:
    """Draws one field of a scene in a plane: `quantity` as shades, F as arrows of unit length, walls as outlines.

    The dark outline is the obstacles', the orange one the boundary that the field itself sees, inflated for the OGF.

    Args:
        axes: where to draw.
        pf: the fields of a scene.
        field: "sgf" or "ogf".
        plane: "xy", "xz" or "yz".
        at_m: place of the plane along its normal [m].
        quantity: "potential", "geodesic_distance", "signed_distance" or "force" (size of F).
        arrows: whether to draw F.
        arrow_spacing_m: between arrows [m].

    Returns:
        The image of the shades, for a colour bar.

    Raises:
        UnknownName: no such field, plane or quantity.
        InvalidConfig: the plane misses the scene.
    """
    guide = named_field(pf, field)
    if quantity not in QUANTITIES:
        raise UnknownName("quantity", quantity, QUANTITIES)
    p_W = slice_points(pf, plane, at_m, 0.5 * pf.grid.resolution_m)
    right, up, normal = PLANES[plane]
    low, high = np.array(pf.scene.bounds_m)
    raw = pf.sgf.signed_distance(p_W)
    inside = guide.signed_distance(p_W) <= 0.0
    values = np.linalg.norm(guide.sample(p_W), axis=-1) if quantity == "force" else getattr(guide, quantity)(p_W)
    shown = np.where(np.isfinite(values) & (~inside | (quantity == "signed_distance")), values, np.nan)
    visible = shown[np.isfinite(shown)]
    image = axes.imshow(
        shown,
        origin="lower",
        extent=(low[right], high[right], low[up], high[up]),
        aspect="equal",
        cmap="Blues_r",
        vmax=float(np.quantile(visible, _CEILING)) if visible.size else None,
        interpolation="bilinear",
    )
    axes.set_facecolor("#e2e8f0")
    grid = (p_W[0, :, right], p_W[:, 0, up])
    axes.contourf(*grid, raw, levels=[-np.inf, 0.0], colors=[WALL_COLOR], alpha=0.85)
    if guide.margin_m > 0.0:
        axes.contour(*grid, raw - guide.margin_m, levels=[0.0], colors=[INFLATED_COLOR], linewidths=1.5)
    if arrows:
        _draw_arrows(axes, guide, slice_points(pf, plane, at_m, arrow_spacing_m), right, up)
    goal_W = pf.scene.goal_W
    if abs(goal_W[normal] - at_m) < 0.5:
        axes.plot(goal_W[right], goal_W[up], marker="*", color=GOAL_COLOR, markersize=13, markeredgecolor="white")
    axes.set_xlabel(f"{'xyz'[right]} [m]")
    axes.set_ylabel(f"{'xyz'[up]} [m]")
    axes.set_title(f"{field.upper()}, {'xyz'[normal]} = {at_m:g} m", fontsize=10)
    return image


def draw_descent(axes: Axes, pf: HodPf, field: str, starts_W: NDArray[np.float64], *, plane: str = "xz", **style: Any):
    """Draws the paths that points (n, 3) in W [m] take along a field; returns them, (steps, n, 3)."""
    right, up, _ = PLANES[plane]
    paths = descend(named_field(pf, field), starts_W)
    axes.plot(paths[..., right], paths[..., up], **{"color": INFLATED_COLOR, "linewidth": 2.0, **style})
    axes.plot(*starts_W[:, [right, up]].T, "o", color="white", markeredgecolor=WALL_COLOR, markersize=6)
    return paths


def named_field(pf: HodPf, field: str) -> GuidanceField:
    """`pf.sgf` or `pf.ogf`. Raises `UnknownName`."""
    if field not in ("sgf", "ogf"):
        raise UnknownName("field", field, ("sgf", "ogf"))
    return getattr(pf, field)


def _draw_arrows(axes: Axes, guide: GuidanceField, p_W: NDArray[np.float64], right: int, up: int) -> None:
    p_W = p_W[guide.signed_distance(p_W) > 0.0]
    force = guide.sample(p_W)[:, [right, up]]
    size = np.linalg.norm(force, axis=-1, keepdims=True)
    axes.quiver(
        *p_W[:, [right, up]].T,
        *(force / np.maximum(size, 1e-9)).T,
        color=ARROW_COLOR,
        alpha=0.75,
        angles="xy",
        scale_units="xy",
        scale=18.0,
        width=0.0026,
        pivot="mid",
    )


def _middles(low: float, high: float, spacing_m: float) -> NDArray[np.float64]:
    count = max(1, round((high - low) / spacing_m))
    return low + (np.arange(count) + 0.5) * (high - low) / count
