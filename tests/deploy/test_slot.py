"""The slot: what goes in comes out, torn records do not, and one guard and one runner at a time."""

import mmap
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from hotice.deploy.slot.double_buffer import TRIES, DoubleBuffer
from hotice.deploy.slot.records import CHECKSUM, COUNTER, STATUS, TARGETS, TARGETS_AT
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
    """A channel with records 1 .. number, the newest of them in half number & 1."""
    memory = mmap.mmap(-1, 4096)
    buffer = DoubleBuffer(memory, TARGETS_AT)
    for k in range(1, number + 1):
        buffer.write(targets(k))
    return memory, buffer


NEWEST = COUNTER + CHECKSUM + TARGETS.itemsize


@pytest.mark.parametrize("byte", [0, NEWEST, NEWEST + 1, NEWEST + 8, NEWEST + 40, NEWEST + 8 + TARGETS.itemsize - 1])
def test_any_changed_byte_is_torn(byte):
    """Counter, checksum or record."""
    memory, buffer = channel(1)
    memory[TARGETS_AT.offset + byte] ^= 2
    assert buffer.read() is None and buffer.torn == 1
    buffer.write(targets(2))
    assert int(buffer.read()["number"]) == 2


@pytest.mark.parametrize("writes", [0, 1, 2])
def test_beside_a_writer_that_writes_or_died_the_record_before_is_whole_and_the_next_one_goes_on(writes):
    memory, buffer = channel(7)
    written = DoubleBuffer(memory, TARGETS_AT)
    left = [writes]

    class Dying:
        """Passes so many writes on."""

        def __getitem__(self, place):
            return written_bytes[place]

        def __setitem__(self, place, data):
            if left[0] == 0:
                raise KeyboardInterrupt
            left[0] -= 1
            written_bytes[place] = data

    written_bytes, written._bytes = written._bytes, Dying()
    with pytest.raises(KeyboardInterrupt):
        written.write(targets(8))
    assert int(buffer.read()["number"]) == 7 and buffer.torn == 0
    buffer.write(targets(9))
    assert int(buffer.read()["number"]) == 9


@pytest.mark.parametrize("quicker", [1, TRIES - 1, TRIES])
def test_a_reader_beside_a_quicker_writer_takes_the_newest_or_nothing_but_never_a_mixture(quicker):
    """Two writes during one look overwrite what is looked at."""
    memory, buffer = channel(1)
    writer, get, number = DoubleBuffer(memory, TARGETS_AT), buffer._get, [1]

    def during(place):
        value = get(place)
        if place and number[0] < 1 + 2 * quicker:
            for _ in range(2):
                number[0] += 1
                writer.write(targets(number[0]))
        return value

    buffer._get = during
    read = buffer.read()
    if quicker == TRIES:
        assert read is None and buffer.torn == 1
    else:
        assert read.tobytes() == targets(number[0]).tobytes() and buffer.torn == 0


def test_a_reader_in_step_with_the_writer_misses_nothing(guard):
    """The guard writes all the time: no read of the runner finds the record in the making."""
    runner, stop = RunnerSlot(NAME), threading.Event()

    def write():
        record = np.zeros((), STATUS)
        while not stop.is_set():
            record["stamp_s"] += 1
            guard.tell(record)

    guard.tell(np.zeros((), STATUS))
    writer = threading.Thread(target=write)
    writer.start()
    try:
        found = [runner.status() for _ in range(20_000)]
    finally:
        stop.set()
        writer.join()
    runner.close()
    assert sum(read is None for read in found) == 0
    stamps = np.array([float(read["stamp_s"]) for read in found])
    assert (np.diff(stamps) >= 0).all() and len(set(stamps.tolist())) > 3


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
