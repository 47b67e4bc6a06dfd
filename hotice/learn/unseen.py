"""Success and distance on unseen scenes against their similarity to the training set (paper, V-A, unseen scenes)."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hotice.errors import InvalidConfig
from hotice.fields.bank import FieldBank
from hotice.fields.similarity import similarity_matrix
from hotice.files import write_bytes
from hotice.model.scene import Scene

POINT_COLOR, LINE_COLOR = "#334155", "#1f6fe5"


@dataclass(frozen=True, kw_only=True)
class Fit:
    """The line y = slope x + intercept of least squares, and the root mean square of what it leaves."""

    slope: float
    intercept: float
    rmse: float

    @classmethod
    def of(cls, x: ArrayLike, y: ArrayLike) -> Fit:
        """Fits (n,) to (n,). Raises `InvalidConfig` for fewer than two different x."""
        x, y = np.asarray(x, dtype=float), np.asarray(y, dtype=float)
        if len(np.unique(x)) < 2:
            raise InvalidConfig(f"{len(x)} scenes of {len(np.unique(x))} similarities: a line needs two that differ")
        slope, intercept = np.polyfit(x, y, 1)
        rest = y - (slope * x + intercept)
        return cls(slope=float(slope), intercept=float(intercept), rmse=float(np.sqrt(np.mean(rest**2))))


def similarities(unseen: Sequence[Scene], training: Sequence[Scene]) -> list[dict[str, Any]]:
    """For each unseen scene its name, largest similarity to the training scenes, and which of them that is."""
    a, b = FieldBank.build(unseen), FieldBank.build(training)
    matrix = similarity_matrix(a, b)
    best = matrix.argmax(axis=1)
    return [
        {"name": scene.name, "similarity": float(matrix[i, j]), "nearest": training[j].name}
        for i, (scene, j) in enumerate(zip(unseen, best.tolist(), strict=True))
    ]


def unseen_points(nearest: Sequence[dict[str, Any]], report: dict[str, Any]) -> dict[str, Any]:
    """Points of the figure and their fits, JSON-ready; `report` of `evaluate` on the same scenes in the same order."""
    kept = ("success_rate", "success_interval_95", "mean_distance_m", "rollouts")
    points = [row | {k: scene[k] for k in kept} for row, scene in zip(nearest, report["scenes"], strict=True)]
    x = [p["similarity"] for p in points]
    fits = {name: vars(Fit.of(x, [p[name] for p in points])) for name in ("success_rate", "mean_distance_m")}
    return {"points": points, "fits": fits}


def draw_unseen(result: dict[str, Any], path: Path) -> Path:
    """Writes the figure (PNG): both measures against similarity, each with its line, shaded by ± RMSE."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.0, 4.2), dpi=120, layout="constrained")
    FigureCanvasAgg(figure)
    x = np.array([p["similarity"] for p in result["points"]])
    ends = np.array([x.min(), x.max()])
    panels = (("success_rate", "success rate [%]", 100.0), ("mean_distance_m", "mean distance to goal [m]", 1.0))
    for axes, letter, (name, label, scale) in zip(figure.subplots(1, 2), "AB", panels, strict=True):
        y = scale * np.array([p[name] for p in result["points"]])
        if name == "success_rate":
            low, high = scale * np.array([p["success_interval_95"] for p in result["points"]]).T
            axes.errorbar(x, y, [np.maximum(y - low, 0), np.maximum(high - y, 0)], fmt="none", color="#94a3b8", lw=0.8)
        axes.plot(x, y, "o", color=POINT_COLOR, markersize=4)
        fit = result["fits"][name]
        line, rmse = scale * (fit["slope"] * ends + fit["intercept"]), scale * fit["rmse"]
        axes.plot(ends, line, color=LINE_COLOR)
        axes.fill_between(ends, line - rmse, line + rmse, color=LINE_COLOR, alpha=0.15, linewidth=0)
        axes.set_xlabel("similarity to the training set")
        axes.set_ylabel(label)
        axes.set_title(f"({letter}) slope {scale * fit['slope']:.3g}, RMSE {rmse:.3g}", fontsize=10, loc="left")
        axes.grid(color="#e2e8f0", linewidth=0.6)
        axes.set_axisbelow(True)
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png")
    return write_bytes(path, buffer.getvalue())
