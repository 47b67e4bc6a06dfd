"""The operator's keys: gamepad by combinations, keyboard by letters, and everything unknown stops."""

import io
import os
import pty
import sys
import termios

import numpy as np
import pytest

from hotice.deploy.guard.keyboard import Keyboard
from hotice.deploy.guard.keys import KEYS, Gamepad
from hotice.deploy.guard.modes import Mode, Request
from hotice.deploy.messages.remote import Sticks, encode_remote
from hotice.deploy.terminal import Terminal
from tests.deploy.guard_fixture import Bench, bench_in


def test_each_combination_is_one_wish():
    for combination, wish in KEYS:
        pad = Gamepad()
        pad.read(encode_remote(), 0.0)
        for part in combination:
            if len(combination) > 1:
                assert wish not in pad.read(encode_remote([part]), 0.1)
        assert pad.read(encode_remote(combination), 0.2) == {wish}
        again = pad.read(encode_remote(combination), 0.3)
        assert again == ({wish} if wish is Request.STOP else set())


def test_what_was_held_at_the_start_counts_for_the_stop_alone():
    pad = Gamepad()
    assert pad.read(encode_remote(["R1", "X"]), 0.0) == set()
    assert Gamepad().read(encode_remote(["select"]), 0.0) == {Request.STOP}
    pad.read(encode_remote(), 0.1)
    assert pad.read(encode_remote(["R1", "X"]), 0.2) == {Request.CARRY}


def test_stop_wins_whatever_else_is_held_and_whatever_the_sticks_hold():
    everything = np.full(40, 255, np.uint8)  # sticks are no numbers
    assert Request.STOP in Gamepad().read(everything, 0.0)
    bench = bench_in(Mode.READY)
    bench.keys = ("R1", "X", "L2", "B")
    assert bench.ticks(1) is Mode.DAMPING


def test_time_without_gamepad():
    pad = Gamepad()
    assert pad.without_s(7.0) == 0.0 and not pad.there
    pad.read(np.zeros(40, np.uint8), 1.0)
    assert pad.without_s(3.0) == 2.0 and not pad.there
    pad.read(encode_remote([], Sticks(lx=0.1)), 3.0)
    assert pad.without_s(3.5) == 0.5 and pad.there


def test_the_whole_way_by_gamepad():
    bench = Bench()
    bench.ticks(300)
    for keys, seconds, mode in (
        (("start",), 0.1, Mode.DAMPING),
        (("L2", "up"), 1.1, Mode.READY),
        (("R1", "A"), 0.1, Mode.PICK_UP),
        (("R1", "X"), 0.1, Mode.CARRY),
        (("R1", "Y"), 0.1, Mode.HOLD),
        (("R1", "down"), 0.1, Mode.LOWER),
        (("L2", "B"), 0.1, Mode.DAMPING),
    ):
        bench.keys = keys
        bench.ticks(2)
        bench.keys = ()
        assert bench.seconds(seconds) is mode


@pytest.fixture
def pipe():
    read, write = os.pipe()
    yield read, write
    os.close(read)


def test_letters(pipe):
    read, write = pipe
    with Keyboard(read) as keyboard:
        assert set(keyboard()) == set()
        for key, wish in (
            ("s", "START"),
            ("p", "POSTURE"),
            ("u", "PICK_UP"),
            ("c", "CARRY"),
            ("h", "HOLD"),
            ("l", "LOWER"),
        ):
            os.write(write, f"{key}\n".encode())
            assert set(keyboard()) == {Request[wish]}
        for key in (" ", "x", "S", "\x1b", "\x00", "\xff"):
            os.write(write, key.encode("latin1"))
            assert set(keyboard()) == {Request.STOP}
        os.write(write, b"cx")
        assert set(keyboard()) == {Request.CARRY, Request.STOP}
        os.close(write)
        assert set(keyboard()) == set() == set(keyboard())


def test_a_program_without_input_has_nothing_typed(monkeypatch):
    for stdin in (None, io.StringIO("s")):
        monkeypatch.setattr(sys, "stdin", stdin)
        with Terminal() as terminal:
            assert terminal.typed() == b"" and terminal.ended and not terminal.there


def test_a_terminal_gives_each_key_at_once_and_is_put_back():
    master, slave = pty.openpty()
    before = termios.tcgetattr(slave)
    with Keyboard(slave) as keyboard:
        os.write(master, b"s")
        assert set(keyboard()) == {Request.START}
        os.write(master, b"\n")
        assert set(keyboard()) == {Request.STOP}
    assert termios.tcgetattr(slave) == before
    os.close(master), os.close(slave)
