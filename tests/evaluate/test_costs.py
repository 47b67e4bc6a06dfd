"""Costs of perturbations, `benchmarks.costs`."""

import importlib
import json
from dataclasses import fields
from pathlib import Path

import pytest

from benchmarks import costs
from benchmarks.costs import BASE, SENSES, compared, main, variants
from hotice.evaluate.trials import Trials
from hotice.model.dynamics import ROBOT_DYNAMICS, DynamicsConfig
from hotice.task.perturbations import SOURCES
from hotice.task.sensing import STUDENT_SENSING


def trials(text):
    outcome = tuple("success" if c == "s" else "fall" for c in text)
    return Trials(outcome=outcome, distance_m=(0.5,) * len(text), time_s=(1.0,) * len(text))


def test_gain_by_hand():
    result = compared(trials("ssff"), trials("sfss"))
    assert (result["won"], result["lost"], result["success"]) == (2, 1, 0.75)
    assert result["gain"] == pytest.approx(0.25)
    # per trial: 0, -1, 1, 1; variance 3/4 - 1/16
    assert result["error"] == pytest.approx((0.6875 / 4) ** 0.5)


def test_every_variant_differs_from_the_base_in_what_it_says():
    known = variants()
    base = known[BASE].task({})
    for name, conditions in known.items():
        task = conditions.task({})
        assert (task == base) is (name == BASE), name
        field = name.removeprefix("dynamics.").removesuffix(" nominal")
        if name.startswith("dynamics."):
            changed = [
                f.name
                for f in fields(DynamicsConfig)
                if getattr(task.dynamics, f.name) != getattr(ROBOT_DYNAMICS, f.name)
            ]
            assert changed == [field]
    assert {f"without {s}" for s in SOURCES} <= known.keys()
    assert {f"dynamics.{f.name} nominal" for f in fields(DynamicsConfig)} <= known.keys()
    for name, sharp in SENSES.items():
        sensing = known[f"sensing.{name} exact"].task({}).sensing
        assert {f.name for f in fields(sensing) if getattr(sensing, f.name) != getattr(STUDENT_SENSING, f.name)} == set(
            sharp
        )
    coarse = known["paper's physics, and its palms"].task({})
    assert (coarse.physics_dt_s, coarse.dynamics.palm_friction) == (0.005, (2.0, 2.0))


def test_unknown_names_are_refused(capsys):
    assert main(["--scenes", "open_floor", "--only", "wind"]) == 2
    assert "wind" in capsys.readouterr().err


@pytest.mark.parametrize("count", ["0", "-1", "1.5", "many", "9" * 400])
def test_counts_that_are_none_are_refused_by_every_benchmark(count, capsys):
    with pytest.raises(SystemExit, match="2"):
        main(["--processes", count])
    assert capsys.readouterr().err.splitlines()[-1].endswith(": a whole number of at least 1 is needed")


def test_benchmarks_take_whole_numbers_by_shared_types():
    sources = [path.read_text() for path in Path(costs.__file__).parent.glob("*.py")]
    assert sum("type=a_count" in source for source in sources) > 10
    assert not [source for source in sources if "type=int" in source]


@pytest.mark.slow
def test_one_trial_each(tmp_path):
    out = tmp_path / "costs.json"
    assert main(["--scenes", "open_floor", "--rollouts", "1", "--only", "pushes", "--out", str(out)]) == 0
    results = json.loads(out.read_text())
    assert set(results) == {BASE, "without pushes"}
    assert all(r["success"] in (0.0, 1.0) for r in results.values())


@pytest.mark.parametrize(
    "benchmark, line, message",
    [
        ("playback", ["--picks", "nope.npz"], "playback: nope.npz: no such file"),
        ("live_fields", ["--scenes", "nope"], "live_fields: "),
        ("deploy_processes", ["--scenes", "nope"], "deploy_processes: "),
    ],
)
def test_what_is_not_there_is_said_by_benchmarks(benchmark, line, message, capsys):
    assert importlib.import_module(f"benchmarks.{benchmark}").main(line) == 2
    assert message in capsys.readouterr().err
