"""Whole jobs on the command line: what they refuse, what is counted and written."""

import csv
import json

import pytest

pytest.importorskip("pydrake")

from hotice.commands.jobs import evaluate as jobs
from hotice.errors import InvalidConfig, PickInfeasible
from hotice.evaluate.config import EvaluateConfig
from hotice.model import load_scene
from hotice.systems.job.run import JobResult


def config(**change):
    return EvaluateConfig(**dict(task="job", policy="student", scenes=("open_floor", "gap"), rollouts=2) | change)


@pytest.mark.parametrize(
    "change",
    [
        {"controller": "walk", "policy": None},
        {"horizon_s": 9.0},
        {"referees": ("exact",)},
        {"protocol": "paper"},
        {"moving": "live"},
        {"without": ("pushes",)},
        {"objects": 8},
        {"batch": 5},
        {"threads": 2},
    ],
)
def test_what_a_job_does_not_have_is_refused(change):
    name = next(iter(change))
    with pytest.raises(InvalidConfig, match=f"{name} is .* and task is 'job', which does not have it: leave it out"):
        config(**change)
    assert config().task == "job"


def test_ends_are_counted_and_written(tmp_path, monkeypatch, capsys):
    """One success and one wrong place on each scene, two refused draws before each."""
    good = dict(goal_m=0.05, lean_rad=0.0, apart_m=0.1, seconds={"pickup": 21.0, "carry": 5.0, "putdown": 22.0})
    ends = [
        JobResult(outcome="success", why="", time_s=48.0, away_m=0.01, **good),
        JobResult(outcome="success", why="", time_s=48.0, away_m=0.03, **good),
        JobResult(outcome="put_down_wrong", why="fall in putdown", time_s=40.0, away_m=0.2, **good),
        JobResult(outcome="fall", why="fall in carry", time_s=23.0, goal_m=1.0, seconds={"pickup": 21.0, "carry": 2.0}),
    ]
    left = list(ends)
    monkeypatch.setattr("hotice.systems.job.run.run_job", lambda station: left.pop(0))
    monkeypatch.setattr(jobs, "draw_job", lambda c, scene, n: (drawn(scene), None, 2))
    report = jobs.evaluate_jobs(config(out=tmp_path / "job.json"))
    assert report["success_rate"] == 0.5 and report["arrived"] == 3 and report["refused_draws"] == 8
    assert report["success_interval_95"] == pytest.approx([0.15, 0.85], abs=0.01)
    assert report["mean_placement_error_m"] == pytest.approx(0.02)
    assert [row["outcomes"] for row in report["scenes"]] == [
        {"success": 1, "put_down_wrong": 1},
        {"success": 1, "fall": 1},
    ]
    assert json.loads((tmp_path / "job.json").read_text()) == report
    rows = list(csv.DictReader((tmp_path / "job.csv").read_text().splitlines()))
    assert [row["outcome"] for row in rows] == [end.outcome for end in ends]
    assert rows[3]["away_m"] == "" and rows[3]["putdown_s"] == "" and rows[0]["scene"] == "open_floor"
    told = capsys.readouterr().out
    assert "2 of 4 jobs done (95 %: 15% to 85%)" in told and "2 of 3 that arrived" in told


def drawn(scene):
    from hotice.systems import StationConfig

    return StationConfig(scene=scene)


def test_draws_without_a_plan_are_made_anew(monkeypatch):
    """The same trial draws the same; where nothing can be planned it says why."""
    seen = []

    def make(config, controller):
        seen.append(config)
        if len(seen) % 3:
            raise PickInfeasible("too high")
        return "a station"

    monkeypatch.setattr("hotice.systems.station.make.make_station", make)
    scene = load_scene("gap")
    first, again = (jobs.draw_job(config(), scene, 1) for _ in range(2))
    assert first == again and first[1:] == ("a station", 2)
    assert first[0].elliptic and first[0].physics_dt_s == 0.002 and first[0].rehearsal.horizon_s == 0.0
    assert all(0.45 <= top <= 0.8 for top in (first[0].support_height_m, first[0].put_height_m))
    assert jobs.draw_job(config(), scene, 2)[0] != first[0]

    def never(config, controller):
        raise PickInfeasible("too high")

    monkeypatch.setattr("hotice.systems.station.make.make_station", never)
    with pytest.raises(InvalidConfig, match="none of 20 objects can be picked up and put down .too high."):
        jobs.draw_job(config(), scene, 1)
