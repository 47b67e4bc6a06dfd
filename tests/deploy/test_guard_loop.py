"""The loop at a fixed rate, on a clock that is told how long each tick takes."""

import numpy as np
import pytest

from hotice.deploy.clock import SimulatedClock
from hotice.deploy.command import DAMPING_KD
from hotice.deploy.guard import process
from hotice.deploy.guard.loop import EDGES_MS, Lateness, run_loop
from hotice.deploy.guard.modes import Request
from hotice.deploy.link.protocol import LinkError
from hotice.deploy.messages.hg import JOINTS
from tests.deploy.guard_fixture import Bench


def run(durations_s):
    clock, times, left = SimulatedClock(5.0), [], list(durations_s)

    def tick():
        times.append(clock.now() - 5.0)
        clock.sleep(left.pop(0))

    seen = run_loop(tick, clock, 500.0, lambda: bool(left))
    return np.array(times), seen


def test_ticks_keep_their_times():
    times, seen = run([0.0005] * 1000)
    assert times == pytest.approx(0.002 * np.arange(1000)) and seen.ticks == 1000 and seen.skipped == 0
    assert seen.worst_late_s < 1e-9 and seen.took[EDGES_MS.index(0.5)] + seen.took[EDGES_MS.index(0.5) + 1] == 1000


def test_what_is_missed_is_left_out():
    times, seen = run([0.0, 0.0, 0.0111, 0.0, 0.0])
    # the third tick lasts from 4 to 15.1 ms: that of 14 ms is late, those between are not made up for
    assert times == pytest.approx([0.0, 0.002, 0.004, 0.0151, 0.016]) and seen.skipped == 4
    assert seen.worst_late_s == pytest.approx(0.0011) and seen.worst_took_s == pytest.approx(0.0111)


def test_the_histogram_counts_every_tick_once():
    seen = Lateness()
    for ms in (0.05, 0.1, 0.15, 3.0, 5000.0):
        seen.add(1e-3 * ms, 0.0)
    assert seen.late[:3].tolist() == [2, 1, 0] and seen.late[-1] == 1 and seen.late.sum() == seen.took.sum() == 5
    assert "5 ticks" in str(seen) and "up to inf ms: 1 late" in str(seen)


class Broken:
    """A slot that fails after some reads."""

    def __init__(self, reads):
        self.left = reads

    def targets(self):
        self.left -= 1
        if self.left < 0:
            raise RuntimeError("a defect of the guard")

    def tell(self, status):
        pass


class Dying:
    """A link of which some methods fail from a time on."""

    def __init__(self, link, clock, **from_s):
        self._link, self._clock, self._from_s = link, clock, from_s

    def __getattr__(self, name):
        def called(*args):
            if self._clock.now() >= self._from_s.get(name, np.inf):
                raise LinkError(f"{name} fails")
            return getattr(self._link, name)(*args)

        return called


def failing(monkeypatch, reads, **from_s):
    """A bench whose slot fails after some reads, after it was guarded to the end; `from_s`: of `Dying`."""
    monkeypatch.setattr(process, "take_precedence", lambda: False)
    bench = Bench()

    class Living(SimulatedClock):
        def sleep(self, seconds):
            super().sleep(seconds)
            bench._robot()

    clock = bench.clock = bench.bus.clock = Living()
    for part in (bench.link._inbox, bench.robot._inbox):
        part.clock = clock
    for way in (bench.bus._commands, bench.link._way):
        way._clock = clock
    link = Dying(bench.link, clock, **from_s)
    with pytest.raises(RuntimeError, match="a defect"):
        process.run_guard(link, Broken(reads), clock, wishes=lambda: {Request.START}, charge=lambda: 80.0)
    return bench


def test_a_guard_that_fails_brakes_before_it_ends(monkeypatch):
    bench = failing(monkeypatch, 400)
    # 400 ticks, of which those from half a second on send, then two seconds of braking
    assert bench.robot.counts().taken == pytest.approx(400 - 251 + 1000, abs=5)
    command = bench.robot.command().record["motor_cmd"][JOINTS]
    assert (command["kp"] == 0).all() and (command["kd"] == DAMPING_KD).all() and (command["mode"] == 1).all()


def test_a_guard_that_can_no_longer_read_brakes_on_and_before_it_ends(monkeypatch):
    """The reader fails, the writer does not: a defect of the guard comes on top of that."""
    bench = failing(monkeypatch, 1000, state=1.0)
    assert bench.robot.counts().taken == pytest.approx(1000 - 251 + 1000, abs=5)


def test_a_message_that_is_not_sent_is_not_the_last_word():
    clock, sent = SimulatedClock(), []

    class Stuttering:
        def publish(self, command):
            if len(sent) < 3 and clock.now() < 0.5:
                raise LinkError("the message was not sent")
            sent.append(command)

    process.last_words(Stuttering(), 5, clock, 500.0)
    assert len(sent) == pytest.approx(750, abs=2) and (sent[-1].kd == DAMPING_KD).all()
