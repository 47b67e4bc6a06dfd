"""`hotice deploy`: what it refuses, what it shows, and the whole chain in three processes over loopback."""

import contextlib
import hashlib
import itertools
import json
import os
import re
import shlex
import signal
import socket
import threading
import time
import urllib.request
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.deploy_processes import Program
from hotice.commands.deploy.config import DeployConfig, fitting_scene
from hotice.commands.deploy.view import View, keys_on
from hotice.console import PlainConsole
from hotice.deploy.guard.modes import Mode
from hotice.deploy.programs.options import GuardOptions, RunnerOptions
from hotice.deploy.programs.prepare import prepare
from hotice.deploy.programs.saying import Saying
from hotice.deploy.recording import replay_log
from hotice.deploy.seeing import read_run, rollout_record
from hotice.deploy.slot import GuardSlot, SlotError, SlotWatch
from hotice.deploy.slot.records import STATUS, TARGETS
from hotice.deploy.slot.slot import slot_path
from hotice.errors import CheckpointError, InvalidConfig
from hotice.machine import usable_cores
from hotice.model import load_scene
from hotice.model.source import MapSource
from tests.samples import sample

REPOSITORY = Path(__file__).parents[2]
DOMAINS = itertools.count(21 + 8 * (os.getpid() % 25))
PORTS = itertools.count(48_000 + 4 * (os.getpid() % 2000), 3)
HEADINGS = ("From start to carried box, simulated", "From a map to a carried box, simulated")
PAGES = int(os.environ.get("HOTICE_PAGES", "1"))
LONG_S = 300.0
SINKS_S = 34.0
"""The page's last key has the motors brake."""


@pytest.mark.parametrize(
    "values",
    [
        {"robot": "go2"},
        {"robot": "g1"},
        {"robot": "g1", "interface": "eth0"},
        {"robot": "g1", "interface": "lo", "map": Path("map.pcd")},
        {"domain": 231},
        {"pose_port": 0},
        {"view_port": 65536},
        {"box": (0.3, 0.3, 0.25, 0.0)},
        {"pose_latency_s": 1.0},
        {"tags_latency_s": -1.0},
        {"moving": "still"},
        {"movers_port": 0},
        {"release_held": True},
        {"robot": "g1", "interface": "eth0", "map": Path("map.pcd"), "release_held": True, "dry_run": True},
    ],
)
def test_what_is_refused(values):
    with pytest.raises(InvalidConfig):
        DeployConfig(**values)


def test_where_the_robot_is():
    assert DeployConfig().network == ("lo", 1) and DeployConfig().slot == "lo-1"
    real = DeployConfig(robot="g1", interface="enp3s0.1", map=Path("map.pcd"))
    assert real.network == ("enp3s0.1", 0) and real.slot == "enp3s0-1-0"


def test_the_map_is_the_one_of_the_scene(tmp_path):
    """A scene that says no map, or another one, is not walked in."""
    path, content = tmp_path / "map.pcd", b"points"
    path.write_bytes(content)
    scene = load_scene("gap")
    with pytest.raises(InvalidConfig, match="says no map"):
        fitting_scene(DeployConfig(scene="gap", map=path))
    source = MapSource(
        file="map.pcd",
        sha256=hashlib.sha256(content).hexdigest(),
        unit_m=1.0,
        position_m=(0.0, 0.0, 0.0),
        quaternion_wxyz=(1.0, 0.0, 0.0, 0.0),
    )
    made = tmp_path / "made.json"
    replace(scene, source=source).save(made)
    assert fitting_scene(DeployConfig(scene=str(made), map=path)).source == source
    path.write_bytes(content + b"!")
    with pytest.raises(InvalidConfig, match="is not the map of scene"):
        fitting_scene(DeployConfig(scene=str(made), map=path))


def test_a_policy_that_reads_something_else_is_refused(monkeypatch):
    monkeypatch.setattr("hotice.deploy.programs.prepare.layout_of", lambda task: [("speed", 1)])
    options = RunnerOptions(
        slot="none", scene="open_floor", policy="student", box=(0.3, 0.3, 0.25, 1.5), pose_port=1, tags_port=2, log=""
    )
    with pytest.raises(CheckpointError, match="observation layout differs"):
        prepare(options, lambda stage: None)


def test_options_as_arguments():
    guard = GuardOptions(slot="a", domain=3, interface="lo", dry_run=True, log="/tmp/x", keep_s=60.0)
    runner = RunnerOptions(
        slot="a", scene="gap", policy="student", box=(0.1, 0.2, 0.3, 4.0), pose_port=1, tags_port=2, log="/tmp/x"
    )
    assert GuardOptions.of(guard.text()) == guard and RunnerOptions.of(runner.text()) == runner


def test_keys_that_lead_on():
    assert keys_on(Mode.OFF) == "s start (start)"
    assert keys_on(Mode.READY).startswith("u pick-up (R1+A), c carry (R1+X), any other key")
    assert keys_on(Mode.DAMPING) == "p posture (L2+up)"
    assert keys_on(Mode.CARRY).startswith("h hold (R1+Y), l lower (R1+down), ")
    assert set(re.findall(r"(\w) [a-z-]+ \(", keys_on(Mode.HOLD))) == {"c", "l"}


def test_who_does_not_listen_is_not_waited_for():
    reader, writer = os.pipe()
    say = Saying(writer)
    for _ in range(2000):
        say(text="x" * 100)
    assert say.dropped > 0
    os.close(reader)
    before = say.dropped
    say(text="gone")
    assert say.dropped == before + 1
    os.close(writer)


def test_a_look_at_a_slot():
    name = f"watch-{os.getpid()}"
    with pytest.raises(SlotError, match="no slot"):
        SlotWatch(name)
    slot = GuardSlot(name)
    with SlotWatch(name) as watch:
        assert watch.status() is None and watch.targets() is None
        status = np.zeros((), STATUS)
        status["mode"] = Mode.READY
        slot.tell(status)
        assert watch.status()["mode"] == Mode.READY
    slot.close()


def test_the_table(capsys):
    status, targets = np.zeros((), STATUS), np.zeros((), TARGETS)
    status["mode"], status["sequence"], status["received_s"], status["entered_s"] = Mode.CARRY, 5, 9.99, 4.0
    targets["stamp_s"], targets["pose_age_s"], targets["box_age_s"] = 9.98, 0.1, np.inf
    view = View(PlainConsole(width=120), "here")
    view.hear("runner", {"warm": True})
    view.hear("guard", {"mode": "CARRY", "text": "carry, asked by the operator", "cause": "OPERATOR", "time_s": 1.0})
    report = {"ticks": 50, "skipped": 1, "worst_late_ms": 3.0, "pose": "ok", "box": "none seen", "goal_m": 1.5}
    view.hear("runner", report)
    PlainConsole(width=120).print(view._table(status, targets, 10.0))
    shown = capsys.readouterr().out
    for part in (
        "carry for 6 s",
        "10 ms old",
        "warm, targets 20 ms old",
        "0.12 s old, ok",
        "never, none seen",
        "1.50 m",
        "guard not known; runner 3.0 ms at most, 1 of 50 skipped",
        "carry: carry, asked by the operator",
    ):
        assert part in shown


def page_commands(heading):
    """Commands of hotice under a heading of docs/deploy.md, each as its arguments."""
    page = (REPOSITORY / "docs" / "deploy.md").read_text()
    section = page.split(f"## {heading}\n")[1].split("\n## ")[0]
    return [shlex.split(line)[1:] for line in section.splitlines() if line.startswith("hotice ")]


@pytest.fixture
def programs():
    """Starts programs, and leaves none."""
    found = []

    def start(*arguments, **options):
        found.append(Program(*arguments, **options))
        return found[-1]

    yield start
    for program in found:
        if program.process.poll() is None:
            # a guard lives in a session of its own: it ends with the program that started it
            program.process.send_signal(signal.SIGTERM)
            program.end()


def shared():
    pytest.importorskip("cyclonedds", reason="the link over DDS needs the extra `deploy`")
    pytest.importorskip("cv2", reason="tags need the extra `deploy`")
    port = next(PORTS)
    return ["--domain", next(DOMAINS), "--pose-port", port, "--tags-port", port + 1]


class Frames:
    """A reader of the live page, until it is over."""

    def __init__(self, url):
        self.count, self.modes, self.over = 0, [], False
        self._stream = urllib.request.urlopen(f"{url}events", timeout=LONG_S)
        self._thread = threading.Thread(target=self._read)
        self._thread.start()

    def _read(self):
        for line in self._stream:
            if line.startswith(b'data: {"time'):
                self.count += 1
                mode = json.loads(line.removeprefix(b"data: "))["mode"]
                self.modes += [mode] if self.modes[-1:] != [mode] else []
            self.over = self.over or line == b"event: over\n"

    def end(self):
        self._thread.join(LONG_S)
        return self.over


class Load:
    """What others ask of this machine's cores, beside a test that runs a robot, its runner and its guard."""

    def __init__(self):
        self._before = os.getloadavg()[0]

    @property
    def busy(self):
        """Whether somebody else may have kept them from being in time: on an idle machine late is a defect."""
        return self._before > 0.5 * usable_cores() or os.getloadavg()[0] > usable_cores()


@pytest.mark.slow
@pytest.mark.alone
@pytest.mark.parametrize("heading", sample(HEADINGS, PAGES))
def test_the_page_leads_from_the_gantry_to_the_goal(heading, programs, tmp_path):
    """Guard, runner and robot in three processes: hung up, handed the box, lowered, carries, holds, lowers, brakes.

    The commands are the page's; where they are to run beside others, and what is looked at, is added behind. One of the
    two a run; `HOTICE_PAGES=2` runs both.
    """
    network, load = shared(), Load()
    *before, first, second = page_commands(heading)
    assert (first[0], second[0]) == ("deploy", "robot-sim") and "--press" in second
    for command in before:
        made = programs(*command, cwd=tmp_path)
        assert made.end() == 0, made.text
    deploy = programs(*first, "--view", "--log", tmp_path / "log", *network, cwd=tmp_path)
    deploy.hear("live page: http")
    frames = Frames(re.search(r"live page: (http://127\.0\.0\.1:\d+/)", deploy.text)[1])
    deploy.hear("runner: warm")
    robot = programs(*second, *network, cwd=tmp_path)
    assert robot.end() == 0
    deploy.process.send_signal(signal.SIGINT)
    assert deploy.end() == 0, deploy.text
    # what comes after that is the robot's end, not a late state
    walked = deploy.text.rpartition("stopped by the operator")[0] or deploy.text
    late = re.search(r"damping: (state is|targets are) 0\.[01]\d+ s old", walked)
    if load.busy and late:
        pytest.skip(f"this machine was too busy, the guard rightly braked: {late[0]}")
    modes = [line.split(":")[0] for line in deploy.lines if re.search(r"(asked|stopped) by the operator|reached", line)]
    assert modes == ["damping", "posture", "ready", "carry", "hold", "lower", "damping"], deploy.text
    found = replay_log(tmp_path / "log")
    assert found.ticks == found.ticks_equal > 1000 and found.actions == found.actions_equal > 100
    assert frames.end() and frames.count > 100 and frames.modes == ["off", *modes]
    run = read_run(tmp_path / "log")
    record = rollout_record(run)
    told = [event.text.split(":")[0] for event in record.events if event.kind == "mode"]
    assert told == modes and record.outcome == "success"
    there = record.time_s > [t for t, event in run.events if event.mode == "hold"][0]
    assert np.linalg.norm(record.root_pos_W[there][0, :2] - run.scene.goal) < 0.12
    assert "refused: none" in robot.text and "given to the robot" in robot.text
    # who brakes at the goal sinks down and may fall against what is behind
    touch = re.search(r"_collision at (\d+\.\d) s", robot.text)
    assert ("no obstacle" in robot.text) if touch is None else float(touch[1]) > SINKS_S, robot.text


@pytest.mark.slow
def test_a_dry_run_sends_nothing_and_a_second_deployment_is_refused(programs):
    """In a scene in which somebody walks: where she is goes from the robot's program to the runner, too."""
    network = shared()
    network = [*network, "--scene", "moving20/01_crossing", "--movers-port", network[-1] + 1]
    deploy = programs("deploy", "--dry-run", "--moving", "live", *network)
    deploy.hear("runner: warm")
    second = programs("deploy", *network)
    assert second.end() == 2 and "has a guard already" in second.text
    held = ("--start", "held", "--duration-s", 8, "--motions-from-s", 1)
    robot = programs("robot-sim", *held, *network, "--press", "start@2s", "L2+up@4s")
    assert robot.end() == 0
    # the box is still aside, and not known
    deploy.hear("localization: not known yet; box: not known yet; movers: ok")
    deploy.hear("posture: posture, asked by the operator")
    assert " 0 taken" in robot.text
    deploy.process.send_signal(signal.SIGINT)
    time.sleep(0.5)
    deploy.process.send_signal(signal.SIGINT)
    assert deploy.end() == 0


@pytest.mark.slow
def test_a_runner_that_refuses_ends_all(programs):
    deploy = programs("deploy", "--policy", "nothing", *shared())
    assert deploy.end() == 2 and "policy 'nothing'" in deploy.text


@pytest.mark.slow
def test_nothing_is_left_of_a_deployment_that_is_killed_before_its_start(programs):
    """Guard and runner end by themselves: the ports of the sources can be used again."""
    network = shared()
    deploy = programs("deploy", *network)
    deploy.hear("runner: warm")
    deploy.process.kill()
    port, end_s, free = network[3], time.monotonic() + LONG_S, False
    while not free and time.monotonic() < end_s:
        time.sleep(0.1)
        with contextlib.suppress(OSError), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as ours:
            ours.bind(("127.0.0.1", port))
            free = True
    assert free and not slot_path(f"lo-{network[1]}").exists()
