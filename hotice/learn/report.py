"""Reports of evaluations: as JSON-ready values and as a printed table."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from hotice.learn.carriers import described
from hotice.learn.trials import CAUSES, PLURAL, Trials
from hotice.learn.version import source_version

if TYPE_CHECKING:
    from rich.console import Console

    from hotice.learn.carriers import Carrier
    from hotice.learn.evaluate import EvaluateConfig

FORMAT = "hotice-report/1"
PAPER_S = 5.0
SHOWN = {"robot_collision": "robot hit", "object_collision": "object hit", "fall": "fall", "drop": "drop"}
SHOWN |= {"timeout": "timeout", "unstable": "unstable", "no_plan": "no plan"}
SELDOM = ("unstable", "no_plan")
"""Causes that have a column only where they occur."""


def make_report(carrier: Carrier, config: EvaluateConfig, scores: Sequence[tuple[str, Trials]]) -> dict[str, Any]:
    """The report of format hotice-report/1; `scores`: name and trials of each scene."""
    return {
        "format": FORMAT, **described(carrier), "seed": config.seed, "rollouts": config.rollouts,
        **Trials.joined(trials for _, trials in scores).rates(),
        "perturbed": config.perturbed, "without": list(config.without),
        "physics": "2 ms, elliptic" if config.fine else "5 ms, pyramidal",
        "objects": {"shapes": list(config.shapes), "size_m": list(config.size_m), "mass_kg": list(config.mass_kg)},
        "horizon_s": config.horizon_s, "source": source_version(),
        "scenes": [{"name": name, **trials.summary()} for name, trials in scores],
    }  # fmt: skip


def print_report(report: dict[str, Any], console: Console) -> None:
    """Prints the report as a table."""
    from rich.table import Table

    task = "noise, delays and pushes" if report["perturbed"] else "no noise"
    task += f" without {', '.join(report['without'])}" if report["without"] else ""
    task += "" if report["horizon_s"] == PAPER_S else f", {report['horizon_s']:g} s"
    who = report["policy"] if report["controller"] == "policy" else f"controller {report['controller']}"
    title = f"{who}: {report['rollouts']} trials a scene, seed {report['seed']}, {report['physics']}, {task}"
    table = Table(title=title)
    table.add_column("scene")
    for name in ("success", "95 %", "distance [m]", "time [s]"):
        table.add_column(name, justify="right")
    causes = [c for c in CAUSES if c not in SELDOM or any(row[PLURAL[c]] for row in report["scenes"])]
    for cause in causes:
        table.add_column(SHOWN[cause], justify="right")
    for row in report["scenes"]:
        time = row["mean_success_time_s"]
        table.add_row(
            row["name"], *_rates(row), "–" if time is None else f"{time:.2f}", *(str(row[PLURAL[c]]) for c in causes)
        )
    table.add_section()
    table.add_row("all", *_rates(report), "", *(str(sum(r[PLURAL[c]] for r in report["scenes"])) for c in causes))
    console.print(table)


def _rates(row: dict[str, Any]) -> tuple[str, str, str]:
    low, high = row["success_interval_95"]
    return f"{row['success_rate']:.1%}", f"{100 * low:.0f}–{100 * high:.0f}", f"{row['mean_distance_m']:.3f}"
