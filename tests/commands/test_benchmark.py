import dataclasses
import json
import re

import pytest

from hotice.commands import benchmark
from hotice.commands.benchmark import SHARES, measure
from hotice.commands.line.benchmark_config import BenchmarkConfig
from hotice.commands.program import main
from hotice.commands.stopwatch import Stopwatch
from hotice.errors import HoticeError, InvalidConfig
from hotice.fields.bank import FieldBank
from hotice.learn.train.config import TrainConfig
from hotice.learn.train.runner import Runner


class Clock:
    """Time that passes only when told."""

    now = 0.0

    def __call__(self):
        return self.now

    def spend(self, seconds):
        self.now += seconds


@pytest.fixture
def clock():
    return Clock()


def test_nested_time_counts_once(clock):
    watch = Stopwatch(clock=clock)

    class Inner:
        size = 3

        def __call__(self, seconds):
            clock.spend(seconds)
            return seconds

    class Outer:
        def __init__(self):
            self.inner = Inner()

        def work(self):
            clock.spend(1.0)
            done = self.inner(0.25)
            clock.spend(2.0)
            return done

    outer = Outer()
    watch.watch(outer, "work", "outer")
    watch.watch(outer, "inner", "inner")
    clock.spend(10.0)
    assert outer.work() == 0.25 and outer.inner.size == 3
    clock.spend(10.0)
    outer.inner(0.5)
    assert watch.seconds == pytest.approx({"outer": 3.0, "inner": 0.75})


def test_time_counts_also_when_a_call_fails(clock):
    watch = Stopwatch(clock=clock)

    def fail():
        clock.spend(1.0)
        raise ValueError

    with pytest.raises(ValueError):
        watch.timed(fail, "failing")()
    assert watch.timed(clock.spend, "after")(2.0) is None
    assert watch.seconds == {"failing": 1.0, "after": 2.0}


def test_waits_at_every_change_of_label(clock):
    waits = []
    watch = Stopwatch(lambda: waits.append(clock.now), clock)
    watch.timed(lambda: watch.timed(clock.spend, "inner")(1.0), "outer")()
    assert waits == [0.0, 0.0, 1.0, 1.0]


def test_shares_add_up_and_the_run_goes_on(tiny, tmp_path):
    runner = Runner(tiny(tmp_path / "run"))
    row = measure(runner, 1, 10)
    assert row["num_envs"] == 8 and set(row["shares"]) == set(SHARES)
    assert sum(row["shares"].values()) == pytest.approx(1.0, abs=0.02) and min(row["shares"].values()) > 0
    assert all(row[f"{kind}_steps_per_s"] > 0 for kind in ("training", "environment", "physics"))
    assert runner.update == 3
    log = runner.learn_once()
    assert log["reward"] == log["reward"]


def test_the_scan_counts_as_fields(clock, tiny, tmp_path, monkeypatch):
    """Where only the scan takes time, all time goes to the fields."""
    task = dataclasses.replace(tiny(tmp_path).task, scan=True)
    runner = Runner(tiny(tmp_path / "run", task=task))
    looked_up = FieldBank.signed_distance

    def slowly(*args):
        clock.spend(1e6)
        return looked_up(*args)

    monkeypatch.setattr(FieldBank, "signed_distance", slowly)
    monkeypatch.setattr(benchmark, "Stopwatch", lambda wait: Stopwatch(wait, clock))
    shares = benchmark._shares(runner, 1, lambda: None)
    assert shares["fields"] > 0 and not any(share for label, share in shares.items() if label != "fields")


def test_the_task_of_students_is_measured(tmp_path, capsys):
    out = tmp_path / "b.json"
    size = ["--num-envs", "4", "--updates", "1", "--steps", "10", "--threads", "1", "--scenes", "open_floor"]
    assert main(["benchmark", *size, "--scan", "--history", "3", "--perturbed", "--out", str(out)]) == 0
    result = json.loads(out.read_text())
    assert (result["scan"], result["history"], result["perturbed"]) == (True, 3, True)
    assert sum(result["sizes"][0]["shares"].values()) == pytest.approx(1.0, abs=0.02)
    assert "dual_hodpf, scan, history 3, perturbed" in capsys.readouterr().out


def test_what_is_measured_is_what_train_would_train():
    training = BenchmarkConfig(scan=True, history=3, perturbed=True).training(1024)
    assert training.perturbed and (training.task.scan, training.task.history) == (True, 3)
    plain = BenchmarkConfig().training(1024)
    assert not plain.perturbed and plain.task == TrainConfig().task


@pytest.mark.parametrize("option", ["--scan", "--history", "--perturbed"])
def test_options_read_as_those_of_train(option, capsys):
    said = []
    for command in ("train", "benchmark"):
        with pytest.raises(SystemExit):
            main([command, "--help"])
        lines = re.sub(r"[│\s]+", " ", capsys.readouterr().out)
        said.append(re.search(rf" {option}\b.*?\(default: [^)]*\)", lines))
    assert said[0] and said[1] and said[0].group() == said[1].group()


@pytest.mark.slow
def test_physics_warp_on_the_cpu(tmp_path):
    """The path that a GPU takes; the first run compiles kernels for some minutes."""
    pytest.importorskip("mujoco_warp")
    out = tmp_path / "b.json"
    options = ["--physics", "warp", "--device", "cpu", "--num-envs", "2", "4", "--steps", "10", "--updates", "1"]
    assert main(["benchmark", *options, "--threads", "1", "--scenes", "open_floor", "--out", str(out)]) == 0
    result = json.loads(out.read_text())
    assert (result["physics"], result["device"]) == ("warp", "cpu") and [r["num_envs"] for r in result["sizes"]] == [
        2,
        4,
    ]


@pytest.mark.parametrize(
    "changes",
    [
        dict(steps=5),
        dict(updates=0),
        dict(threads=0),
        dict(num_envs=(0,)),
        dict(num_envs=(8, -1)),
        dict(physics="x"),
        dict(preset="triple"),
        dict(scenes=()),
        dict(device="tpu"),
        dict(history=-1),
        dict(history=10**6),
    ],
)
def test_impossible_benchmarks_are_refused(changes):
    with pytest.raises(HoticeError):
        BenchmarkConfig(**changes)


def test_no_size_is_refused():
    with pytest.raises(InvalidConfig, match="num_envs"):
        BenchmarkConfig(num_envs=())
