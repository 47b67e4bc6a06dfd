"""Lines where standard error is no terminal; nothing at all of quick work."""

import re
import time

import pytest

from hotice import progress


@pytest.fixture
def soon(monkeypatch):
    monkeypatch.setattr(progress, "EVERY_S", 0.01)


def wait_for(capsys, text):
    """Until a line says this, and the time."""
    said, end = [], time.monotonic() + 60.0
    while not any(re.fullmatch(re.escape(text) + r"(, some .* left)?, \d+ s", line) for line in said):
        assert time.monotonic() < end, said
        time.sleep(0.01)
        said += capsys.readouterr().err.splitlines()


def test_counts_are_told_in_lines(soon, capsys):
    with progress.counting("trials", 2000, 500) as told:
        wait_for(capsys, "trials: 500 of 2,000")
        told(1500)
        wait_for(capsys, "trials: 1,500 of 2,000")
    capsys.readouterr()
    time.sleep(0.05)
    assert capsys.readouterr().err == "", "over is over"


def test_what_is_done_is_told_in_lines(soon, capsys):
    with progress.doing("importing [bold]x[/nonsense]") as told:
        wait_for(capsys, "importing [bold]x[/nonsense]")
        told("film: frame 3 of 9")
        wait_for(capsys, "film: frame 3 of 9")


def test_items_count_when_they_are_done(soon, capsys):
    items = progress.counted("ab", "scenes", 2)
    assert next(items) == "a"
    wait_for(capsys, "scenes: 0 of 2")
    assert next(items) == "b"
    wait_for(capsys, "scenes: 1 of 2")
    assert list(items) == []


def test_quick_work_says_nothing(capsys):
    with progress.doing("a"), progress.counting("b", 3) as told:
        told(3)
    assert list(progress.counted([1, 2], "c", 2)) == [1, 2]
    assert capsys.readouterr().err == ""


def test_errors_come_through_and_the_lines_end(soon, capsys):
    with pytest.raises(KeyError), progress.doing("a"):
        raise KeyError
    capsys.readouterr()
    time.sleep(0.05)
    assert capsys.readouterr().err == ""


def test_a_terminal_has_a_bar(monkeypatch, capsys):
    monkeypatch.setenv("FORCE_COLOR", "1")
    with progress.counting("trials", 4) as told:
        told(4)
    with progress.doing("[/bold]") as told:
        told("[/nonsense]")
    said = capsys.readouterr().err
    assert "trials" in said and "━" in said and "[/nonsense]" in said


def test_what_is_left_is_said_at_the_rate_so_far(monkeypatch):
    monkeypatch.setattr(time, "monotonic", lambda: 100.0)
    assert progress.left(10, 30, 40.0) == ", some 3 min left"
    assert progress.left(0, 30, 40.0) == progress.left(10, 0, 40.0) == ""
    assert [progress.in_words(s) for s in (12.4, 89, 600, 4 * 3600)] == ["12 s", "89 s", "10 min", "4.0 h"]
