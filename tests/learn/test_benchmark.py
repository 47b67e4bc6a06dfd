import json

import pytest

from hotice.errors import HoticeError, InvalidConfig
from hotice.learn.__main__ import main
from hotice.learn.benchmark import SHARES, BenchmarkConfig, measure
from hotice.learn.runner import Runner
from hotice.learn.stopwatch import Stopwatch


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
    "changes", [dict(steps=5), dict(updates=0), dict(threads=0), dict(num_envs=(0,)), dict(num_envs=(8, -1)), dict(physics="x"),
                dict(preset="triple"), dict(scenes=()), dict(device="tpu")],
)  # fmt: skip
def test_impossible_benchmarks_are_refused(changes):
    with pytest.raises(HoticeError):
        BenchmarkConfig(**changes)


def test_no_size_is_refused():
    with pytest.raises(InvalidConfig, match="num_envs"):
        BenchmarkConfig(num_envs=())
