"""What a run leaves in its folder while it goes on, read back."""

import json
import re

import pytest

from hotice.learn.train.progress import LOG, Progress

NUMBERS = {"reward": 0.123456789, "steps_per_s": 1234.5, "share/fall": 0.25}


def rows(folder):
    return [json.loads(line) for line in (folder / LOG).read_text().splitlines()]


def test_a_line_an_update(tiny, tmp_path, capsys):
    with Progress(tiny(tmp_path / "run"), 0) as progress:
        progress.report(1, 64, 0.12345, NUMBERS)
        assert rows(tmp_path / "run") == [
            {"update": 1, "steps": 64, "minutes": 0.123, "reward": 0.12346, "steps_per_s": 1234.5, "share/fall": 0.25}
        ], "each is there as soon as it is reported"
        progress.report(2, 128, 0.2, NUMBERS | {"reward": 0.5})
        progress.note("by the way")
    assert [r["update"] for r in rows(tmp_path / "run")] == [1, 2]
    said = capsys.readouterr().err
    assert said.count("update 1: 0.00 M steps, 1234/s, reward 0.12, fall 0.25") == 1 and "by the way" in said
    assert "update 2" not in said, "beside a terminal only now and then"


def test_tensorboard_has_the_same_over_steps(tiny, tmp_path):
    accumulator = pytest.importorskip("tensorboard.backend.event_processing.event_accumulator")
    with Progress(tiny(tmp_path / "run"), 0) as progress:
        progress.report(1, 64, 0.1, NUMBERS)
        progress.report(2, 128, 0.2, NUMBERS | {"reward": 0.5})
    events = accumulator.EventAccumulator(str(tmp_path / "run" / "tensorboard"))
    events.Reload()
    assert set(events.Tags()["scalars"]) == set(NUMBERS)
    seen = [(e.step, e.value) for e in events.Scalars("reward")]
    assert seen == [(64, pytest.approx(0.123456789)), (128, pytest.approx(0.5))]


@pytest.mark.parametrize("resume, kept", [(True, [1, 2]), (False, [1, 2, 3])])
def test_only_a_run_that_goes_on_drops_what_it_makes_anew(tiny, tmp_path, resume, kept):
    out = tmp_path / "run"
    with Progress(tiny(out), 0) as progress:
        for update in (1, 2, 3):
            progress.report(update, 64 * update, 0.1, NUMBERS)
    with Progress(tiny(out, resume=resume), 2) as progress:
        assert [r["update"] for r in rows(out)] == kept
        progress.report(3, 192, 0.1, NUMBERS | {"reward": 9.0})
    assert [r["update"] for r in rows(out)] == [*kept, 3] and rows(out)[-1]["reward"] == 9.0


def test_tensorboard_shows_each_step_once_after_a_kill(tiny, tmp_path):
    """Three updates were logged, two are in the checkpoint: the third is made anew, with another value."""
    accumulator = pytest.importorskip("tensorboard.backend.event_processing.event_accumulator")
    out = tmp_path / "run"
    with Progress(tiny(out), 0) as progress:
        for update in (1, 2, 3):
            progress.report(update, 64 * update, 0.1, NUMBERS | {"reward": float(update)})
    with Progress(tiny(out, resume=True), 2, 128) as progress:
        for update in (3, 4):
            progress.report(update, 64 * update, 0.1, NUMBERS | {"reward": 10.0 * update})
    events = accumulator.EventAccumulator(str(out / "tensorboard"))
    events.Reload()
    assert [(e.step, e.value) for e in events.Scalars("reward")] == [(64, 1.0), (128, 2.0), (192, 30.0), (256, 40.0)]


def test_a_run_that_goes_on_tells_tensorboard_where(tiny, tmp_path, monkeypatch):
    from hotice.learn.train import progress
    from hotice.learn.train.runner import Runner

    begun, plain = [], progress.SummaryWriter
    monkeypatch.setattr(progress, "SummaryWriter", lambda *a, **k: (begun.append(k["purge_step"]), plain(*a, **k))[1])
    Runner(tiny(tmp_path / "run", updates=2)).train()
    Runner(tiny(tmp_path / "run", updates=3, resume=True)).train()
    assert begun == [None, 2 * 64 + 1]


def test_no_episode_of_a_log_is_longer_than_what_was_simulated(tiny, tmp_path):
    """Episodes of 15 steps, updates of 8; the first ones begin at any step, and are no episodes."""
    from hotice.learn.train.runner import Runner

    Runner(tiny(tmp_path / "whole", updates=4, num_envs=16)).train()
    Runner(tiny(tmp_path / "parts", updates=2, num_envs=16)).train()
    Runner(tiny(tmp_path / "parts", updates=4, num_envs=16, resume=True)).train()
    for name in ("whole", "parts"):
        logged = rows(tmp_path / name)
        assert [r["update"] for r in logged] == [1, 2, 3, 4]
        assert all(r.get("length", 0) <= min(8 * r["update"], 15) for r in logged), logged
        assert logged[0].get("share/timeout", 0) == 0, "none had 15 steps after 8"
        assert sum(r["episodes"] for r in logged) > 0
    counts = [[(r["episodes"], r.get("length")) for r in rows(tmp_path / name)] for name in ("whole", "parts")]
    assert counts[0] == counts[1]


@pytest.mark.parametrize(
    "limits, said",
    [
        ({"max_minutes": 30.0}, ", 30 min left"),
        ({"updates": 4}, ", some .* left"),
        ({"updates": 1_000_000}, "fall 0.25$"),
    ],
)
def test_when_a_run_ends_is_said(tiny, tmp_path, capsys, limits, said):
    with Progress(tiny(tmp_path / "run", **limits), 0) as progress:
        progress.report(1, 64, 0.1, NUMBERS)
    assert re.search(said, capsys.readouterr().err.strip())
