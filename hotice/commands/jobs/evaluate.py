"""`hotice evaluate --task job`: whole jobs, counted by where each ended. Drake is imported only for them."""

from __future__ import annotations

import csv
import io
import json
from collections import Counter
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.table import Table

from hotice.console import PlainConsole
from hotice.errors import CarryInfeasible, InvalidConfig, PickInfeasible
from hotice.evaluate.config import EvaluateConfig
from hotice.evaluate.trials import success_interval
from hotice.files import check_writable, is_folder, write_text
from hotice.model.object_range import ObjectRange
from hotice.model.scene_digest import scene_digest
from hotice.model.shipped import resolve_scenes
from hotice.progress import counting
from hotice.task.protocols import get_protocol
from hotice.task.sensing import STUDENT_SENSING, SensingConfig
from hotice.version import source_version

if TYPE_CHECKING:
    from hotice.model.scene import Scene
    from hotice.systems import StationConfig
    from hotice.systems.job.run import JobResult
    from hotice.systems.station.make import Station

FORMAT = "hotice-job-report/1"
TOPS_M = (0.45, 0.8)
"""Heights of both supports (ours)."""
NEAR_M = 0.24
DRAWS = 20


@dataclass(frozen=True, kw_only=True)
class Job:
    """One trial: what was drawn, how many draws were refused before it, and how it ended."""

    scene: str
    number: int
    carried: str
    pick_top_m: float
    put_top_m: float
    refused: int
    result: JobResult

    def row(self) -> dict[str, Any]:
        """Plain values; what is not a number is None."""
        row: dict[str, Any] = asdict(self)
        result = row.pop("result")
        seconds = {f"{stage}_s": value for stage, value in result.pop("seconds").items()}
        row |= result | {f"{stage}_s": None for stage in ("pickup", "carry", "putdown")} | seconds
        return {k: None if isinstance(v, float) and not np.isfinite(v) else v for k, v in row.items()}


def evaluate_jobs(config: EvaluateConfig) -> dict[str, Any]:
    """Runs the jobs of an evaluation one after another, prints a table, writes report and OUT.csv as they end.

    Raises `HoticeError`: `MissingExtra` without Drake, a scene without room for a support.
    """
    from hotice.systems.job.run import run_job

    if config.policy is not None and is_folder(config.policy):
        raise InvalidConfig(f"policy is {config.policy!r}: a job takes an exported one, make it with `hotice export`")
    if config.out is not None:
        check_writable(config.out)
        check_writable(_table_of(config.out))
    scenes, jobs, report = resolve_scenes(config.scenes), [], {}
    with counting("jobs", config.rollouts * len(scenes), 0) as told:
        for number in range(config.rollouts):
            for scene in scenes:
                drawn, station, refused = draw_job(config, scene, number)
                jobs.append(
                    Job(
                        scene=scene.name,
                        number=number,
                        carried=str(drawn.carried),
                        pick_top_m=drawn.support_height_m,
                        put_top_m=drawn.put_height_m,
                        refused=refused,
                        result=run_job(station),
                    )
                )
                report = make_report(config, [s.name for s in scenes], jobs)
                if config.out is not None:
                    write_text(config.out, json.dumps(report, indent=1) + "\n")
                    write_text(_table_of(config.out), as_csv(jobs))
                told(len(jobs))
    print_report(report)
    return report


def draw_job(config: EvaluateConfig, scene: Scene, number: int) -> tuple[StationConfig, Station, int]:
    """Configuration and station of a trial, the first draw that can be planned, and how many were refused before it.

    A trial depends on the seed, the scene by its content, and its number. Raises `InvalidConfig` where all are refused.
    """
    from hotice.systems import StationConfig
    from hotice.systems.setup.put import before_goal
    from hotice.systems.setup.rehearsal_config import RehearsalConfig
    from hotice.systems.setup.table import beside_start
    from hotice.systems.station.make import make_station

    protocol = get_protocol("robot")
    rng = np.random.default_rng([config.seed, int(scene_digest(scene)[:8], 16), number])
    assert config.policy is not None
    base = StationConfig(
        scene=scene,
        policy=config.policy,
        sensing=STUDENT_SENSING if config.perturbed else SensingConfig(),
        dynamics=protocol.dynamics if config.perturbed else protocol.nominal,
        seed=int(rng.integers(2**31)),
        physics_dt_s=protocol.physics_dt_s,
        elliptic=protocol.elliptic,
        support_near_m=NEAR_M,
        put_near_m=NEAR_M,
        rehearsal=RehearsalConfig(horizon_s=0.0),
    )
    objects = ObjectRange(shapes=config.shapes, size_m=config.size_m, mass_kg=config.mass_kg)
    why = ""
    for refused in range(DRAWS):
        carried, (pick, put) = objects.sample(rng), rng.uniform(*TOPS_M, 2)
        drawn = replace(base, carried=carried, support_height_m=float(pick), put_height_m=float(put))
        drawn = before_goal(scene, beside_start(scene, drawn))
        try:
            return drawn, make_station(drawn, controller="job"), refused
        except (CarryInfeasible, PickInfeasible) as error:
            why = str(error)
    raise InvalidConfig(
        f"none of {DRAWS} objects can be picked up and put down ({why}): try other sizes or another seed"
    )


def make_report(config: EvaluateConfig, scenes: list[str], jobs: list[Job]) -> dict[str, Any]:
    """The report, JSON-ready: success with its interval, ends by scene, placement of what was put down, every trial."""
    done = [job for job in jobs if job.result.outcome == "success"]
    arrived = [job for job in jobs if "putdown" in job.result.seconds]
    off = [job.result.away_m for job in done]
    return {
        "format": FORMAT,
        "policy": config.policy,
        "protocol": "robot",
        "perturbed": config.perturbed,
        "seed": config.seed,
        "rollouts": len(jobs),
        "success_rate": len(done) / len(jobs),
        "success_interval_95": list(success_interval(len(done), len(jobs))),
        "arrived": len(arrived),
        "put_down_of_arrived": len(done) / len(arrived) if arrived else None,
        "mean_placement_error_m": float(np.mean(off)) if off else None,
        "largest_placement_error_m": float(np.max(off)) if off else None,
        "refused_draws": sum(job.refused for job in jobs),
        "source": source_version(),
        "scenes": [_scene_row(name, [job for job in jobs if job.scene == name]) for name in scenes],
        "trials": [job.row() for job in jobs],
    }


def _scene_row(name: str, jobs: list[Job]) -> dict[str, Any]:
    ends = Counter(job.result.outcome for job in jobs)
    return {"name": name, "rollouts": len(jobs), "outcomes": dict(ends.most_common())}


def as_csv(jobs: list[Job]) -> str:
    """A row a trial."""
    text = io.StringIO()
    rows = [job.row() for job in jobs]
    writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


def print_report(report: dict[str, Any]) -> None:
    """A table by scene, and the sums below it."""
    console = PlainConsole(width=None if PlainConsole().is_terminal else 130)
    table = Table("scene", "jobs", "success", "ended otherwise")
    for row in report["scenes"]:
        ends = dict(row["outcomes"])
        good = ends.pop("success", 0)
        others = ", ".join(f"{count} {name.replace('_', ' ')}" for name, count in ends.items())
        table.add_row(row["name"], str(row["rollouts"]), str(good), others)
    console.print(table)
    low, high = report["success_interval_95"]
    good = round(report["success_rate"] * report["rollouts"])
    console.print(f"{good} of {report['rollouts']} jobs done (95 %: {low:.0%} to {high:.0%})")
    if report["arrived"]:
        console.print(f"put down well: {good} of {report['arrived']} that arrived and were taken over")
    if report["mean_placement_error_m"] is not None:
        mean, most = (100 * report[f"{name}_placement_error_m"] for name in ("mean", "largest"))
        console.print(f"placement of those: {mean:.1f} cm off in the mean, at most {most:.1f} cm")


def _table_of(out: Path) -> Path:
    return out.with_suffix(".csv")
