"""The slot: what goes in comes out, torn records do not, and one guard and one runner at a time."""

import mmap
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from hotice.deploy.slot.records import STATUS, TARGETS, TARGETS_AT
from hotice.deploy.slot.sequence_lock import SequenceLocked
from hotice.deploy.slot.slot import FOLDER, GuardSlot, RunnerSlot, SlotError, slot_path

NAME = f"test-{os.getpid()}"


@pytest.fixture
def guard():
    slot = GuardSlot(NAME)
    yield slot
    slot.close()


def targets(number):
    record = np.zeros((), TARGETS)
    record["number"], record["stamp_s"] = number, 0.02 * number
    record["q"], record["tau"] = np.linspace(-1, 1, 29) + number, number
    return record


def test_both_ways(guard):
    runner = RunnerSlot(NAME)
    assert guard.targets() is None and runner.status() is None
    for number in range(1, 5):
        runner.put(targets(number))
        assert guard.targets().tobytes() == targets(number).tobytes()
    status = np.zeros((), STATUS)
    status["mode"], status["state"]["tick"] = 5, 77
    guard.tell(status)
    read = runner.status()
    assert read.tobytes() == status.tobytes() and not read.flags.writeable and guard.torn == 0
    runner.close()
    runner.close()


def channel(number):
    memory = mmap.mmap(-1, 4096)
    locked = SequenceLocked(memory, TARGETS_AT)
    locked.write(targets(number))
    return memory, locked


@pytest.mark.parametrize("byte", [0, 8, 9, 16, 40, 16 + TARGETS.itemsize - 1])
def test_any_changed_byte_is_torn(byte):
    """Counter, checksum or record: a writer that stopped at any place."""
    memory, locked = channel(1)
    memory[TARGETS_AT.offset + byte] ^= 1
    assert locked.read() is None and locked.torn == 1
    locked.write(targets(2))
    assert int(locked.read()["number"]) == 2


def test_a_writer_that_died_in_the_middle_leaves_nothing_and_the_next_one_goes_on():
    memory, locked = channel(1)
    counter = int.from_bytes(memory[TARGETS_AT.offset : TARGETS_AT.offset + 8], "little")
    memory[TARGETS_AT.offset : TARGETS_AT.offset + 8] = (counter + 1).to_bytes(8, "little")
    assert locked.read() is None
    locked.write(targets(9))
    assert int(locked.read()["number"]) == 9


def test_a_record_that_changes_while_it_is_read_is_torn():
    memory, locked = channel(1)
    get = locked._get

    def during(place):
        value = get(place)
        if place == 8:  # the checksum, which is read last before the counter again
            locked._get = get
            locked.write(targets(2))
        return value

    locked._get = during
    assert locked.read() is None and locked.torn == 1
    assert int(locked.read()["number"]) == 2


def test_one_guard_and_one_runner(guard):
    with pytest.raises(SlotError, match="has a guard already"):
        GuardSlot(NAME)
    runner = RunnerSlot(NAME)
    with pytest.raises(SlotError, match="has a runner already"):
        RunnerSlot(NAME)
    runner.close()
    RunnerSlot(NAME).close()


def test_a_closed_guard_leaves_no_file():
    slot = GuardSlot(NAME)
    assert slot_path(NAME).exists()
    slot.close()
    slot.close()
    assert not slot_path(NAME).exists()
    with pytest.raises(SlotError, match="start its guard first"):
        RunnerSlot(NAME)


def test_what_a_killed_guard_left_is_replaced():
    code = f"from hotice.deploy.slot.slot import GuardSlot; s = GuardSlot({NAME!r}); print(1, flush=True); input()"
    dead = subprocess.Popen([sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    dead.stdout.readline()
    with pytest.raises(SlotError, match="has a guard already"):
        GuardSlot(NAME)
    old = RunnerSlot(NAME)
    dead.send_signal(signal.SIGKILL)
    dead.wait()
    dead.stdin.close(), dead.stdout.close()
    assert slot_path(NAME).exists()
    with pytest.raises(SlotError, match="left by a guard that is gone"):
        RunnerSlot(NAME)
    new = GuardSlot(NAME)
    old.put(targets(3))  # a runner that was left over speaks to nobody
    assert new.targets() is None
    RunnerSlot(NAME).close()
    new.close(), old.close()
    assert not slot_path(NAME).exists()


def test_another_layout_is_refused(guard):
    guard._memory[:4] = b"????"
    with pytest.raises(SlotError, match="another layout"):
        RunnerSlot(NAME)


@pytest.mark.parametrize("name", ["", "../x", "A", "a" * 41, "a b", ".."])
def test_impossible_names(name):
    with pytest.raises(SlotError, match="name of a slot"):
        GuardSlot(name)


def test_a_link_in_the_files_place_is_not_followed(tmp_path):
    victim = tmp_path / "victim"
    victim.write_text("mine")
    path = slot_path(NAME)
    path.symlink_to(victim)
    try:
        with pytest.raises(SlotError, match="cannot be opened"):
            GuardSlot(NAME)
    finally:
        path.unlink()
    assert victim.read_text() == "mine" and FOLDER == path.parent


def test_two_processes_never_see_a_mixed_record(guard):
    """A writer as fast as it can: each record that is read is whole."""
    code = (
        f"import numpy as np\nfrom hotice.deploy.slot.slot import RunnerSlot\n"
        f"from tests.deploy.test_slot import targets\ns = RunnerSlot({NAME!r})\n"
        "for i in range(1, 20001): s.put(targets(i))\n"
    )
    # the child imports this module: its folder is the first place that it looks in
    writer = subprocess.Popen([sys.executable, "-c", code], cwd=Path(__file__).parents[2])
    seen, last = 0, 0
    end = time.monotonic() + 60.0
    while last < 20000 and time.monotonic() < end:
        record = guard.targets()
        if record is not None:
            last = int(record["number"])
            assert record.tobytes() == targets(last).tobytes()
            seen += 1
    assert writer.wait() == 0 and last == 20000 and seen > 10
