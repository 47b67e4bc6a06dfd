"""What a run leaves in its folder while it goes on, read back."""

import json

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
