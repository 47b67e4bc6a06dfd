"""Compiling beforehand: once for each state of the sources, and never where commands are read line by line."""

import pytest

from hotice.commands import warm


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setattr(warm.compiled, "kept_in", lambda: tmp_path)
    monkeypatch.delenv("HOTICE_QUIET")
    return tmp_path


def test_what_is_warm_is_not_warmed_again(folder, monkeypatch):
    calls = []
    monkeypatch.setattr(warm, "warm", lambda console: calls.append(console.stderr))
    warm.warm_once()
    assert calls == [True], "what it says is beside what the command prints"
    (folder / warm.DONE).write_text("")
    warm.warm_once()
    assert calls == [True]


def test_not_where_every_line_is_read_or_nothing_is_kept(folder, monkeypatch):
    monkeypatch.setattr(warm, "warm", lambda console: pytest.fail("warmed"))
    with monkeypatch.context() as patch:
        patch.setenv("HOTICE_QUIET", "1")
        warm.warm_once()
    monkeypatch.setattr(warm.compiled, "kept_in", lambda: None)
    warm.warm_once()


@pytest.mark.slow
def test_warming_runs_and_says_what_it_did(folder, capsys):
    warm.warm()
    assert (folder / warm.DONE).exists()
    assert "compile" in capsys.readouterr().out
