"""The log of a robot: what was written comes back, torn ends do not, and a full disk stops nobody."""

import os
import signal
import subprocess
import sys
import textwrap

import numpy as np
import pytest

from hotice.deploy.log.frames import MAGIC, LogHeader, frame, frames
from hotice.deploy.log.reader import read_log
from hotice.deploy.log.writer import LogWriter
from hotice.deploy.messages.hg import LOW_STATE
from hotice.errors import InputError, OutputError

TARGET = np.dtype([("sequence", "<u8"), ("q", "<f4", (20,))])
KINDS = {"state": LOW_STATE.zeros().dtype, "target": TARGET, "note": None}


def targets(count):
    rng = np.random.default_rng(0)
    out = np.zeros(count, TARGET)
    out["sequence"], out["q"] = np.arange(count), rng.normal(size=(count, 20))
    return out


def test_everything_comes_back(tmp_path):
    written, state = targets(50), LOW_STATE.zeros()
    state["tick"] = 7
    with LogWriter(tmp_path, "runner", KINDS, {"scene": "abc"}, segment_s=0.3) as log:
        for i, target in enumerate(written):
            assert log.write("target", 0.02 * i, target)
            assert log.write("state", 0.02 * i, state)
        log.write("note", 1.0, b"fault: tick frozen")
    log.close()
    assert (log.written, log.dropped, log.error) == (101, 0, None)
    assert len(list(tmp_path.iterdir())) == 4
    read = read_log(tmp_path, "runner")
    assert (read.writer, read.about, read.torn_bytes) == ("runner", {"scene": "abc"}, 0)
    assert read.entries["target"].records.tobytes() == written.tobytes()
    assert read.entries["target"].records.dtype == TARGET
    np.testing.assert_array_equal(read.entries["target"].time_s, 0.02 * np.arange(50))
    assert read.entries["state"].records.tobytes() == 50 * state.tobytes()
    assert read.entries["state"].records["motor_state"]["q"].shape == (50, 35)
    assert read.entries["note"].records == [b"fault: tick frozen"]


def test_only_the_last_seconds_are_kept(tmp_path):
    with LogWriter(tmp_path, "guard", {"note": None}, segment_s=1.0, keep_s=3.0) as log:
        for i in range(1000):
            log.write("note", 0.02 * i, b"%d" % i)
    times = read_log(tmp_path, "guard").entries["note"].time_s
    assert times[-1] == pytest.approx(19.98)
    assert 3.0 <= times[-1] - times[0] <= 5.1
    np.testing.assert_allclose(np.diff(times), 0.02)


@pytest.mark.parametrize("cut", [1, 17, 18, 30, 100])
def test_a_torn_end_costs_one_entry(tmp_path, cut):
    with LogWriter(tmp_path, "guard", {"target": TARGET}) as log:
        for target in targets(10):
            log.write("target", 0.0, target)
    path = tmp_path / "guard-000000.log"
    path.write_bytes(path.read_bytes()[:-cut])
    read = read_log(tmp_path, "guard")
    one = TARGET.itemsize + 18
    lost = -(-cut // one)
    assert len(read.entries["target"].records) == 10 - lost
    assert read.torn_bytes == lost * one - cut


def test_damage_in_the_middle_is_seen(tmp_path):
    with LogWriter(tmp_path, "guard", {"target": TARGET}) as log:
        for target in targets(10):
            log.write("target", 0.0, target)
    path = tmp_path / "guard-000000.log"
    content = path.read_bytes()
    rng = np.random.default_rng(0)
    begin = len(content) - 10 * (TARGET.itemsize + 18)
    for _ in range(50):
        at = int(rng.integers(begin, len(content)))
        damaged = bytearray(content)
        damaged[at] ^= 1 << int(rng.integers(8))
        path.write_bytes(bytes(damaged))
        read = read_log(tmp_path, "guard")
        assert len(read.entries["target"].records) == (at - begin) // (TARGET.itemsize + 18)
        assert read.torn_bytes > 0


@pytest.mark.parametrize("damage", ["magic", "length", "text", "empty", "objects", "kinds"])
def test_damaged_headers_are_refused(tmp_path, damage):
    content = bytearray(LogHeader(writer="guard", segment=0, kinds={"target": TARGET}).to_bytes())
    if damage == "magic":
        content[0] ^= 1
    elif damage == "length":
        content[len(MAGIC)] ^= 1
    elif damage == "text":
        content[-20] ^= 1
    elif damage == "empty":
        content = bytearray()
    else:
        text = {"objects": b'{"writer": "guard", "segment": 0, "kinds": {"x": "|O"}, "about": {}}', "kinds": b"[1]"}
        import zlib

        text = text[damage]
        size, check = (n.to_bytes(4, "little") for n in (len(text), zlib.crc32(text)))
        content = bytearray(MAGIC + size + text + check)
    (tmp_path / "guard-000000.log").write_bytes(bytes(content))
    with pytest.raises(InputError, match="guard-000000"):
        read_log(tmp_path, "guard")


def test_missing_logs_are_named(tmp_path):
    with pytest.raises(InputError, match="no such folder"):
        read_log(tmp_path / "none", "guard")
    with LogWriter(tmp_path, "runner", {"note": None}):
        pass
    with pytest.raises(InputError, match="'guard'; there are logs of runner"):
        read_log(tmp_path, "guard")
    with pytest.raises(OutputError, match="has a log already"):
        LogWriter(tmp_path, "runner", {"note": None})


def test_a_lost_segment_is_seen(tmp_path):
    with LogWriter(tmp_path, "guard", {"note": None}, segment_s=1.0) as log:
        for i in range(200):
            log.write("note", 0.02 * i, b"x")
    (tmp_path / "guard-000001.log").unlink()
    with pytest.raises(InputError, match="not the next segment"):
        read_log(tmp_path, "guard")


def test_a_disk_that_fails_stops_nobody(tmp_path):
    log = LogWriter(tmp_path, "guard", {"note": None})
    log._file.close()
    log._file = open("/dev/full", "wb", buffering=0)
    for i in range(20):
        log.write("note", 0.01 * i, b"x" * 1000)
    log.close()
    assert "No space left" in log.error
    assert not log.write("note", 1.0, b"x")
    assert log.dropped == 21


def test_entries_of_another_size_are_refused(tmp_path):
    with LogWriter(tmp_path, "guard", {"target": TARGET, "note": None}) as log:
        with pytest.raises(ValueError, match="88 are needed"):
            log.write("target", 0.0, b"short")
        with pytest.raises(ValueError, match="at most"):
            log.write("note", 0.0, bytes(2**20 + 1))


def test_frames_of_random_bytes_end():
    rng = np.random.default_rng(0)
    good = b"".join(frame(0, 0.0, bytes(rng.integers(0, 256, n, dtype=np.uint8))) for n in (0, 5, 100))
    assert [len(p) for _, _, p in frames(good, 0)] == [0, 5, 100]
    for _ in range(500):
        assert len(list(frames(rng.bytes(200), 0))) == 0


def test_a_killed_process_leaves_what_was_flushed(tmp_path):
    code = textwrap.dedent(
        f"""
        import time
        from hotice.deploy.log.writer import LogWriter
        log = LogWriter({str(tmp_path)!r}, "guard", {{"note": None}})
        for i in range(100):
            log.write("note", 0.01 * i, b"entry %d" % i)
        time.sleep(0.5)
        print("ready", flush=True)
        time.sleep(60)
        """
    )
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline() == "ready\n"
        os.kill(process.pid, signal.SIGKILL)
    assert len(read_log(tmp_path, "guard").entries["note"].records) == 100
