"""`hotice robot-sim`: its loop on a clock of its own, and the whole program in a process over loopback."""

import itertools
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from hotice.commands.robot_sim_config import RobotSimConfig
from hotice.deploy.clock import MonotonicClock, SimulatedClock
from hotice.deploy.command import LIMITS, CheckedCommand
from hotice.deploy.messages.hg import JOINTS
from hotice.deploy.messages.remote import KEYS as REMOTE_KEYS
from hotice.deploy.simulated.keys import KEYS, pressed_by
from hotice.deploy.simulated.real_time import live
from hotice.deploy.sources import PoseSample, TagSample, UdpSource
from hotice.deploy.switcher import SERVICE, active_controller, leave_high_level
from hotice.errors import InvalidConfig

REPOSITORY = Path(__file__).parents[2]
DOMAINS = itertools.count(20 + 8 * (os.getpid() % 25))
LONG_S = 60.0


class Slow(SimulatedClock):
    """Sleeps exactly; each step takes what it is told."""

    def __init__(self, takes_s):
        super().__init__()
        self._takes, self.began_s = iter(takes_s), []

    def step(self):
        self.began_s.append(self.now())
        super().sleep(next(self._takes))


def test_steps_begin_every_two_milliseconds():
    clock = Slow([0.001] * 5)
    lateness = live(clock.step, clock, lambda: len(clock.began_s) < 5)
    assert clock.began_s == pytest.approx([0.002, 0.004, 0.006, 0.008, 0.010])
    assert (
        lateness.steps == 5 and lateness.worst_s == pytest.approx(0.0, abs=1e-9) and lateness.share_below(0.05) == 1.0
    )


def test_what_is_late_is_made_up_for():
    clock = Slow([0.0115, 0.001, 0.001, 0.001, 0.001, 0.001, 0.001, 0.001, 0.001, 0.001])
    lateness = live(clock.step, clock, lambda: len(clock.began_s) < 10)
    assert clock.began_s[-1] == pytest.approx(0.0215)
    assert lateness.worst_s == pytest.approx(0.0095) and lateness.slipped_s == 0.0
    assert lateness.share_below(10.0) == 1.0 and lateness.share_below(5.0) < 1.0


def test_what_is_too_late_slips():
    clock = Slow([0.302, 0.0, 0.0])
    lateness = live(clock.step, clock, lambda: len(clock.began_s) < 3)
    assert lateness.slipped_s == pytest.approx(0.3)
    assert clock.began_s == pytest.approx([0.002, 0.304, 0.306])


def test_letters_of_the_terminal_are_keys_of_the_gamepad():
    assert pressed_by(b"sx\xff b") == [("start",), ("select",), ("L2", "B")]
    assert {key for keys in KEYS.values() for key in keys} <= set(REMOTE_KEYS)


@pytest.mark.parametrize(
    "values",
    [{"domain": 0, "interface": "eth0"}, {"domain": 231}, {"duration_s": 0.0}, {"pose_port": 0}, {"tags_port": 70000}],
)
def test_what_is_refused(values):
    with pytest.raises(InvalidConfig):
        RobotSimConfig(**values)


def test_the_robots_domain_on_loopback_is_allowed():
    assert RobotSimConfig(domain=0).domain == 0


def wait_for(what, value):
    """What a function returns as soon as it is something."""
    end_s = time.monotonic() + LONG_S
    while time.monotonic() < end_s:
        if (found := value()) is not None:
            return found
        time.sleep(0.002)
    raise AssertionError(f"{what} never came")


@pytest.mark.slow
def test_the_program_over_loopback():
    pytest.importorskip("cyclonedds", reason="the link over DDS needs the extra `deploy`")
    from hotice.deploy.dds import DdsLink, DdsNode, DdsService
    from hotice.deploy.dds.battery import DdsBattery

    domain = next(DOMAINS)
    poses, tags = UdpSource(0, PoseSample.decode), UdpSource(0, TagSample.decode)
    options = ["--domain", domain, "--pose-port", poses.port, "--tags-port", tags.port, "--battery-percent", 70]
    process = subprocess.Popen(
        [sys.executable, "-m", "hotice.commands.program", "robot-sim", *map(str, options)],
        cwd=REPOSITORY,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    try:
        with DdsNode(domain=domain, interface="lo") as node:
            link, battery, service = DdsLink(node), DdsBattery(node), DdsService(node, SERVICE)
            clock = MonotonicClock()
            state = wait_for("a state", link.state)
            assert state.mode_machine == 5
            assert wait_for("the battery", battery.charge) == 70.0
            assert wait_for("a pose", poses.newest).sample.p_ML[2] > 0.9
            assert wait_for("tags", tags.newest).sample.ids.tolist() == [0, 1, 2, 3]
            assert active_controller(service, timeout_s=LONG_S) == "ai"
            leave_high_level(service, clock, robot_is_held=True, timeout_s=LONG_S, pause_s=0.0)

            zero = np.zeros(29)
            command = CheckedCommand(
                q=zero, dq=zero, tau=zero, kp=zero, kd=np.minimum(LIMITS.kd, 3.0), enabled=np.ones(29, bool)
            )

            def motors_on():
                link.publish(command)
                received = link.state()
                return received if received and received.record["motor_state"]["mode"][JOINTS].all() else None

            released = wait_for("motors off", lambda: None if np.any(link.state().record["motor_state"]["mode"]) else 1)
            assert released and wait_for("motors on", motors_on).tick > state.tick
            assert link.counts().foreign_commands == 0
            for end in (service, battery, link):
                end.close()
        process.send_signal(signal.SIGINT)
        out, _ = process.communicate(timeout=LONG_S)
        assert process.returncode == 0, out
        assert "steps late" in out and "refused: none" in out
    finally:
        process.kill()
        poses.close()
        tags.close()
