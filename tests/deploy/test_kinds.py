"""Kinds of a robot's log: their types are those of what they hold."""

import subprocess
import sys

import numpy as np
import pytest

from hotice.deploy.guard.faults import Cause
from hotice.deploy.guard.modes import Mode
from hotice.deploy.log.kinds import GUARD_KINDS, PERCEPT, READING, RUNNER_KINDS, decode_event, encode_event
from hotice.deploy.log.reader import read_log
from hotice.deploy.log.writer import LogWriter
from hotice.errors import InputError
from hotice.policy.guidance import FieldReading
from hotice.policy.percept import Percept


@pytest.mark.parametrize(("vector", "kind"), [(Percept, PERCEPT), (FieldReading, READING)])
def test_vectors_are_read_by_their_parts(vector, kind):
    numbers = vector(np.arange(vector.SIZE, dtype=float))
    record = np.frombuffer(numbers.vector.tobytes(), kind)[0]
    assert kind.names == tuple(vector.SHAPES)
    for name in kind.names:
        np.testing.assert_array_equal(record[name], getattr(numbers, name))


def test_events_come_back():
    event = decode_event(encode_event(Mode.PICK_UP, Cause.BOX_UNSEEN, 'hold: "box" not seen'))
    assert event == ("pick up", "box unseen", 'hold: "box" not seen')
    for bad in (b"", b"[]", b'{"mode": "hold"}', b'{"mode": 3, "cause": "none", "text": ""}'):
        with pytest.raises(InputError, match="event of the log"):
            decode_event(bad)


@pytest.mark.parametrize(("name", "kinds"), [("guard", GUARD_KINDS), ("runner", RUNNER_KINDS)])
def test_all_kinds_can_be_written_and_read(tmp_path, name, kinds):
    with LogWriter(tmp_path, name, kinds) as log:
        for kind, dtype in kinds.items():
            log.write(kind, 1.0, b"{}" if dtype is None else np.zeros((), dtype))
    read = read_log(tmp_path, name)
    assert {kind: len(entries.records) for kind, entries in read.entries.items()} == dict.fromkeys(kinds, 1)
    for kind, dtype in kinds.items():
        assert dtype is None or read.entries[kind].records.dtype == dtype


def test_the_guard_can_name_them_with_numpy_alone():
    code = "import sys, hotice.deploy.log.kinds; print({'mujoco', 'scipy', 'numba', 'yaml'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"
