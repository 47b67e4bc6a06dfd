"""Unseen scenes as Markdown and as a figure."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np

from hotice.commands.unseen import GROUPS
from hotice.files import write_bytes

LINE_COLOR = "#1f6fe5"


def unseen_markdown(result: dict[str, Any]) -> str:
    """Fits and groups of `unseen_points` as Markdown."""
    training = result["training"]
    lines = ["Least squares against similarity to the training scenes (`unseen.png`):", ""]
    lines += [
        f"- {name}: {fit['slope']:+.3f} × similarity {fit['intercept']:+.3f}, RMSE {fit['rmse']:.3f}"
        for name, fit in result["fits"].items()
    ]
    lines += [
        "",
        f"Similarity is the largest to {training['compared']} training scenes of the policy and its ancestors.",
    ]
    if training["left_out"]:
        lines += ["It is a lower bound, for these could not be made again:", ""]
        lines += [f"- `{g['scenes']}`: {g['missing']} of {g['count']}: {g['reason']}" for g in training["left_out"]]
    lines += ["", "| Unseen scenes | Scenes | Trials | SR [%] | 95 % | mDist [m] | Mean similarity | Families |"]
    lines += ["|---|---|---|---|---|---|---|---|"]
    for key, group in result["groups"].items():
        low, high = group["success_interval_95"]
        lines.append(
            f"| {GROUPS[key].title} | {group['scenes']} | {group['rollouts']} | {100 * group['success_rate']:.1f} | "
            f"{100 * low:.1f}–{100 * high:.1f} | {group['mean_distance_m']:.3f} | {group['mean_similarity']:.3f} | "
            f"{', '.join(group['families']) or '–'} |"
        )
    return "\n".join(lines)


def draw_unseen(result: dict[str, Any], path: Path) -> Path:
    """Figure (PNG): both measures against similarity, groups by marker, each with its line and a band of ± RMSE."""
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
        for key, group in GROUPS.items():
            of = np.array([p["group"] == key for p in result["points"]])
            if of.any():
                label_of = f"{group.title} ({of.sum()})"
                axes.plot(x[of], y[of], group.marker, color=group.color, markersize=5, label=label_of)
        fit = result["fits"][name]
        line, rmse = scale * (fit["slope"] * ends + fit["intercept"]), scale * fit["rmse"]
        axes.plot(ends, line, color=LINE_COLOR)
        axes.fill_between(ends, line - rmse, line + rmse, color=LINE_COLOR, alpha=0.15, linewidth=0)
        axes.set_xlabel(f"largest similarity to {result['training']['compared']} training scenes")
        axes.set_ylabel(label)
        axes.set_title(f"({letter}) slope {scale * fit['slope']:.3g}, RMSE {rmse:.3g}", fontsize=10, loc="left")
        axes.grid(color="#e2e8f0", linewidth=0.6)
        axes.set_axisbelow(True)
        axes.legend(fontsize=8, framealpha=0.9)
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png")
    return write_bytes(path, buffer.getvalue())
