"""One owner of a folder, whatever becomes of it."""

import os
import signal
import subprocess
import sys

import pytest

from hotice.errors import OutputError
from hotice.owner import LOCK, check_unowned, sole_owner

HOLD = """
import pathlib, sys, time
from hotice.owner import sole_owner
with sole_owner(pathlib.Path(sys.argv[1])):
    print("mine", flush=True)
    time.sleep(60)
"""


@pytest.fixture
def other(tmp_path):
    """Another process that owns the folder `tmp_path/run`."""
    process = subprocess.Popen([sys.executable, "-c", HOLD, str(tmp_path / "run")], stdout=subprocess.PIPE, text=True)
    assert process.stdout.readline() == "mine\n"
    yield process
    process.kill()
    process.communicate()


def test_a_folder_that_stays_empty_is_left_as_it_was(tmp_path):
    with sole_owner(tmp_path / "run"):
        assert [p.name for p in (tmp_path / "run").iterdir()] == [LOCK]
    assert not list(tmp_path.iterdir())
    (tmp_path / "there").mkdir()
    with sole_owner(tmp_path / "there"):
        pass
    assert [p.name for p in tmp_path.iterdir()] == ["there"] and not list((tmp_path / "there").iterdir())


def test_what_is_written_stays_and_the_lock_goes_also_after_an_error(tmp_path):
    with pytest.raises(KeyError), sole_owner(tmp_path / "run"):
        (tmp_path / "run" / "a").touch()
        raise KeyError
    assert [p.name for p in (tmp_path / "run").iterdir()] == ["a"]


def test_a_second_owner_is_refused_and_told_who_the_first_is(tmp_path, other):
    run, who = tmp_path / "run", f"process {other.pid} on "
    before = (run / LOCK).read_text()
    for attempt in (check_unowned, lambda folder: sole_owner(folder).__enter__()):
        with pytest.raises(OutputError, match=f"^{run}: {who}.* is at work in it: wait .*another folder as --out"):
            attempt(run)
        assert (run / LOCK).read_text() == before and before.startswith(who)
    check_unowned(tmp_path / "elsewhere")
    assert not (tmp_path / "elsewhere").exists()


def test_nobody_owns_what_a_killed_process_left(tmp_path, other):
    other.send_signal(signal.SIGKILL)
    other.wait()
    assert (tmp_path / "run" / LOCK).exists()
    check_unowned(tmp_path / "run")
    with sole_owner(tmp_path / "run"):
        assert (tmp_path / "run" / LOCK).read_text().startswith(f"process {os.getpid()} on ")


def test_a_lock_that_is_removed_while_it_is_waited_for_is_taken_anew(tmp_path, monkeypatch):
    from hotice import owner

    real, calls = owner.try_lock, []

    def removed_first(file):
        calls.append(file)
        if len(calls) == 1:
            (tmp_path / LOCK).unlink()
        return real(file)

    monkeypatch.setattr(owner, "try_lock", removed_first)
    with sole_owner(tmp_path):
        assert len(calls) == 2
        with open(tmp_path / LOCK) as file:
            assert not real(file)


def test_an_owner_that_ends_while_it_is_asked_for_owns_nothing(tmp_path, monkeypatch):
    monkeypatch.setattr(type(tmp_path), "is_file", lambda path: True)
    check_unowned(tmp_path)


def test_a_lock_that_is_a_pipe_is_refused(tmp_path):
    os.mkfifo(tmp_path / LOCK)
    check_unowned(tmp_path)
    with pytest.raises(OutputError, match="device, pipe or socket"), sole_owner(tmp_path):
        pass
    with pytest.raises(OutputError, match="cannot be locked"), sole_owner(tmp_path / LOCK / "run"):
        pass
