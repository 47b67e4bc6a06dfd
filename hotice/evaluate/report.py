"""Reports of evaluations: as JSON-ready values and as a printed table."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import TYPE_CHECKING, Any

from hotice.evaluate.carriers import Carrier, described
from hotice.evaluate.config import PAPER_S, EvaluateConfig
from hotice.evaluate.trials import CAUSES, DEEP_M, ONLY_MOVING, PLURAL, Trials
from hotice.version import source_version

if TYPE_CHECKING:
    from hotice.console import PlainConsole

FORMAT = "hotice-report/1"
SHOWN = {"robot_collision": "robot\nhit", "object_collision": "object\nhit", "fall": "fall", "drop": "drop"}
SHOWN |= {"timeout": "time-\nout", "unstable": "un-\nstable", "no_plan": "no\nplan", "walked_into": "walked\ninto"}
SELDOM = ("unstable", "no_plan", "walked_into")
"""Causes that have a column only where they occur."""


def make_report(
    carrier: Carrier, config: EvaluateConfig, scores: Sequence[tuple[str, Trials]], moving: Collection[str] = ()
) -> dict[str, Any]:
    """The report of format hotice-report/1.

    `scores`: name and trials of each scene; `moving`: names of those in which something moves.
    """
    return {
        "format": FORMAT,
        **described(carrier),
        "seed": config.seed,
        "rollouts": config.rollouts,
        **Trials.joined(trials for _, trials in scores).rates(),
        "perturbed": config.perturbed,
        "without": list(config.without),
        "protocol": config.protocol,
        "physics": config.conditions.physics,
        "referees": list(config.judges),
        "objects": {"shapes": list(config.shapes), "size_m": list(config.size_m), "mass_kg": list(config.mass_kg)},
        "horizon_s": config.horizon_s,
        **({"moving": config.moving} if moving else {}),
        "source": source_version(),
        "scenes": [{"name": name, **trials.summary(name in moving)} for name, trials in scores],
    }


def print_report(report: dict[str, Any], console: PlainConsole) -> None:
    """Prints the report as a table."""
    from rich import box
    from rich.table import Table

    task = "noise, delays and pushes" if report["perturbed"] else "no noise"
    task += f" without {', '.join(report['without'])}" if report["without"] else ""
    task += "" if report["horizon_s"] == PAPER_S else f", {report['horizon_s']:g} s"
    task += f", of movers known: {report['moving']}" if "moving" in report else ""
    who = report["policy"] if report["controller"] == "policy" else f"controller {report['controller']}"
    by_points = report["points"] is not None
    heads = ["success\n%", "95\n%", *(["points\n%", "points\nhit"] if by_points else []), "end\nm"]
    heads += [f"{report['horizon_s']:g} s\nm", "stands\n%", "stays\n%", "time\ns"]
    title = (
        f"{who}, protocol {report['protocol']} ({report['physics']}): {report['rollouts']} trials a scene, "
        f"seed {report['seed']}, {task}"
    )
    table = Table(title=title, box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0))
    table.add_column("scene", overflow="fold")
    for name in heads:
        table.add_column(name, justify="right")
    rows = report["scenes"]
    causes = [c for c in CAUSES if c not in SELDOM or any(row.get(PLURAL[c]) for row in rows)]
    if "moving" in report:
        causes = [*causes, *(c for c in ONLY_MOVING if c not in causes)]
    for cause in causes:
        table.add_column(SHOWN[cause], justify="right")
    for row in report["scenes"]:
        table.add_row(row["name"], *_cells(row, by_points), *(str(row.get(PLURAL[c], "–")) for c in causes))
    table.add_section()
    sums = {PLURAL[c]: sum(r.get(PLURAL[c], 0) for r in rows) for c in causes}
    table.add_row("all", *_cells(report, by_points), *map(str, sums.values()))
    console.print(table)
    if (within := report["self_contact"]) is not None:
        console.print(
            f"contact within the robot: {within['share']:.1%} of trials, {within['deep_share']:.1%} deeper than "
            f"{1e3 * DEEP_M:g} mm, {1e3 * within['deepest_m']:.0f} mm at most"
        )


def _cells(row: dict[str, Any], by_points: bool) -> list[str]:
    """Rates, distances and times of a row; a dash where nothing is known."""
    low, high = row["success_interval_95"]
    cells = [_percent(row["success_rate"]), f"{100 * low:.0f}–{100 * high:.0f}"]
    if by_points:
        seen = row["points"]
        cells += [_percent(seen["success_rate"]), str(seen["robot_collisions"] + seen["object_collisions"])]
    cells += [_metres(row["mean_distance_m"]), _metres(row["mean_distance_at_limit_m"])]
    cells += [_percent(row["standing_share"]), _percent(row["stayed_share"])]
    time = row.get("mean_success_time_s")
    return [*cells, "–" if time is None else f"{time:.2f}"]


def _percent(share: float | None) -> str:
    return "–" if share is None else f"{100 * share:.1f}"


def _metres(distance_m: float | None) -> str:
    return "–" if distance_m is None else f"{distance_m:.3f}"
