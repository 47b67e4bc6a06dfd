"""The paper's tables of simulation results: their rows, the paper's numbers, and Markdown of ours beside them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from hotice.learn.checkpoints.trained_on import in_words

MISSING = "no policy"


@dataclass(frozen=True, kw_only=True)
class Row:
    """A method of a table. `policy`: which policy makes its numbers; several rows may share one."""

    label: str
    policy: str
    success_rate: float
    mean_distance_m: float


@dataclass(frozen=True, kw_only=True)
class Table:
    """A table of the paper, with the paper's numbers."""

    title: str
    scenes: str
    rows: tuple[Row, ...]


TABLES: Mapping[str, Table] = {
    "table1": Table(
        title="Table I: four presets, boxes, 20 scenes",
        scenes="bench20",
        rows=(
            Row(label="Single-Agent & SGF", policy="single_sgf", success_rate=0.587, mean_distance_m=0.296),
            Row(label="Single-Agent & HOD-PF", policy="single_hodpf", success_rate=0.657, mean_distance_m=0.267),
            Row(label="Dual-Agent & SGF", policy="dual_sgf", success_rate=0.771, mean_distance_m=0.195),
            Row(label="Dual-Agent & HOD-PF", policy="dual_hodpf", success_rate=0.885, mean_distance_m=0.130),
        ),
    ),
    "table2": Table(
        title="Table II: three object shapes, 20 scenes",
        scenes="bench20",
        rows=(
            Row(label="Cuboid", policy="dual_hodpf", success_rate=0.885, mean_distance_m=0.130),
            Row(label="Cylinder", policy="cylinder", success_rate=0.867, mean_distance_m=0.127),
            Row(label="Sphere", policy="sphere", success_rate=0.872, mean_distance_m=0.131),
        ),
    ),
    "unseen": Table(
        title="Unseen scenes: one generalist, boxes, 50 scenes",
        scenes="unseen50",
        rows=(Row(label="Dual-Agent & HOD-PF", policy="generalist", success_rate=0.801, mean_distance_m=0.27),),
    ),
}
"""Table III of the paper was measured on the robot: there is nothing to simulate."""


@dataclass(frozen=True, kw_only=True)
class Made:
    """A policy's report on a set of scenes, the command that made it, and the one that trained the policy, if known."""

    report: dict[str, Any]
    evaluated_by: str
    trained_by: str | None

    def origin(self) -> dict[str, Any]:
        """Source of a number, JSON-ready."""
        trained = self.report["trained"]
        return {
            "policy": self.report["policy"],
            "preset": self.report["preset"],
            "trained": trained,
            "trained_by": self.trained_by,
            "evaluated_by": self.evaluated_by,
            "protocol": self.report.get("protocol"),
            "perturbed": self.report["perturbed"],
            "evaluated_with": self.report["source"],
        }


def table_markdown(table: Table, made: Mapping[str, Made]) -> str:
    """A table as Markdown, ours beside the paper's; a row without a policy says so."""
    protocols = sorted({f"protocol {_protocol(m.report)}" for m in made.values()})
    lines = [
        f"## {table.title}",
        "",
        *([f"{', '.join(protocols)}, referee exact", ""] if protocols else []),
        "| Method | SR [%] | 95 % | mDist [m] | Trials | Paper SR [%] | Paper mDist [m] | Steps |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for row in table.rows:
        theirs = f"{100 * row.success_rate:.1f} | {row.mean_distance_m:.3f}"
        if row.policy not in made:
            lines.append(f"| {row.label} | {MISSING} `{row.policy}` | – | – | 0 | {theirs} | – |")
            continue
        report = made[row.policy].report
        low, high = report["success_interval_95"]
        steps = report["trained"].get("total_steps", report["trained"].get("steps"))
        lines.append(
            f"| {row.label} | {100 * report['success_rate']:.1f} | {100 * low:.1f}–{100 * high:.1f} | "
            f"{report['mean_distance_m']:.3f} | {sum(s['rollouts'] for s in report['scenes'])} | {theirs} | "
            f"{'?' if steps is None else f'{steps / 1e6:.2f} M'} |"
        )
    return "\n".join(lines)


def origins_markdown(made: Mapping[str, Made]) -> str:
    """Training of each policy, and the command that made its numbers."""
    lines = ["## Where the numbers are from", ""]
    for name, entry in made.items():
        trained = entry.report["trained"]
        source = trained.get("source", {})
        lines += [
            f"- `{name}`: {entry.report['policy']}, preset `{entry.report['preset']}`, trained for "
            f"{trained.get('steps', '?')} steps{_behind(trained)} "
            f"({trained.get('updates', '?')} updates, {trained.get('minutes', '?')} minutes, "
            f"seed {trained.get('seed', '?')}) at commit `{source.get('commit', 'unknown')}`",
            *([f"  - trained on: {in_words(trained['on'])}"] if "on" in trained else []),
            f"  - trained by: {f'`{entry.trained_by}`' if entry.trained_by else 'given, its command is not recorded'}",
            f"  - protocol: {_protocol(entry.report)}, referee exact",
            f"  - evaluated by: `{entry.evaluated_by}`, at commit `{entry.report['source'].get('commit', 'unknown')}`",
        ]
    return "\n".join(lines)


def _protocol(report: Mapping[str, Any]) -> str:
    """Name and physics of a report; reports of earlier versions name none."""
    return f"{report.get('protocol') or 'none named'} ({report.get('physics', 'unknown physics')})"


def _behind(trained: Mapping[str, Any]) -> str:
    """Steps of what a policy began from, as words."""
    before = trained.get("total_steps", 0) - trained.get("steps", 0)
    return f" after {before} of the checkpoints that it began from" if before > 0 else ""


def tables_json(tables: Sequence[str], made: Mapping[str, Made]) -> dict[str, Any]:
    """The same numbers with their origins, JSON-ready."""
    result: dict[str, Any] = {}
    for name in tables:
        rows = []
        for row in TABLES[name].rows:
            entry: dict[str, Any] = {
                "label": row.label,
                "policy": row.policy,
                "paper": {"success_rate": row.success_rate, "mean_distance_m": row.mean_distance_m},
                "ours": None,
            }
            if row.policy in made:
                report = made[row.policy].report
                kept = ("success_rate", "success_interval_95", "mean_distance_m", "rollouts")
                entry |= {"ours": {k: report[k] for k in kept}, "origin": made[row.policy].origin()}
            rows.append(entry)
        result[name] = {"title": TABLES[name].title, "scenes": TABLES[name].scenes, "rows": rows}
    return result
