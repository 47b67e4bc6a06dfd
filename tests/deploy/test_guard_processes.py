"""Guard, runner and robot as processes in real time: whatever dies, the motors brake."""

import os
import signal
import subprocess
import sys
import time

import pytest

from benchmarks.guard import CAUSES, ROOT, Player, stage
from hotice.deploy.slot.slot import slot_path

SLOT = f"processes-{os.getpid()}"


def delays(causes, count):
    """(delay [s], what it may be) of each trial: the figures of an idle machine, and as late as this one was."""
    with stage(SLOT) as players:
        found = [players.delay_s(cause, 0.1 + 0.007 * i) for cause in causes for i in range(count)]
        seen = players.end()
    return found, 0.1 + seen["worst_late_s"] + seen["worst_took_s"]


def test_a_runner_that_is_killed_or_stopped():
    found, most = delays(CAUSES[:2], 1)
    assert len(found) == 2 and max(found) <= most
    assert not slot_path(SLOT).exists()


@pytest.mark.slow
def test_every_cause_twice():
    found, most = delays(CAUSES, 2)
    assert len(found) == 10 and max(found) <= most


def test_a_second_guard_refuses():
    with stage(SLOT) as players:
        second = subprocess.run(
            [sys.executable, "-m", "benchmarks.guard", "--role", "guard", "--slot", SLOT],
            cwd=ROOT,
            capture_output=True,
            text=True,
            stdin=subprocess.DEVNULL,
        )
        assert second.returncode != 0 and "has a guard already" in second.stderr
        assert players.end()["ticks"] > 0


def test_a_guard_that_was_killed_is_followed_by_another():
    with stage(SLOT) as players:
        players.guard.end(signal.SIGKILL)
    assert slot_path(SLOT).exists()
    with stage(SLOT) as players:
        assert players.end()["ticks"] > 0
    assert not slot_path(SLOT).exists()


def test_a_signal_brakes_before_it_ends():
    with stage(SLOT) as players:
        runner = Player("runner", SLOT, None)
        players.guard.hear(lambda said: said.get("mode") == "CARRY")
        since_s = time.monotonic()
        players.guard.process.send_signal(signal.SIGINT)
        damped = players.guard.hear(lambda said: said.get("mode") == "DAMPING")
        players.guard.hear(lambda said: "ticks" in said)
        runner.end(signal.SIGKILL)
        # two seconds of braking lie between
        assert damped["cause"] == "OPERATOR" and time.monotonic() - since_s >= 2.0
