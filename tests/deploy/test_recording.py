"""Logs of guard and runner: what a runner did comes out again bit for bit, and what was changed does not."""

import json
import os
import time
from dataclasses import replace

import numpy as np
import pytest

from hotice.caches import VARIABLE
from hotice.commands.program import main
from hotice.deploy.clock import SimulatedClock
from hotice.deploy.command import LIMITS
from hotice.deploy.guard import Cause, Event, Mode
from hotice.deploy.link.memory import MemoryBus
from hotice.deploy.log.reader import read_log
from hotice.deploy.log.writer import LogWriter
from hotice.deploy.messages.hg import JOINTS
from hotice.deploy.programs.options import RunnerOptions
from hotice.deploy.programs.prepare import around_of, estimator_of, prepare
from hotice.deploy.recording import GuardLog, RunnerLog, replay_log, ring_folder
from hotice.deploy.recording.guard_log import KINDS, LoggedSlot
from hotice.deploy.recording.place import KEPT
from hotice.deploy.recording.replay import digests
from hotice.deploy.recording.runner_log import kinds, width
from hotice.deploy.runner import RobotRunner
from hotice.deploy.runner.ways import LiveWays
from hotice.deploy.seeing.mcap_file import messages
from hotice.deploy.seeing.recorded import read_run
from hotice.deploy.slot.records import STATUS, TARGETS
from hotice.deploy.sources import PoseSample
from hotice.errors import InputError
from hotice.fields import build_hod_pf
from hotice.model import Scene
from hotice.model.moving import walking_person
from hotice.policy import read_fields
from tests.deploy.messages_fixture import low_state
from tests.deploy.simulated_fixture import Lab, command

TICKS = 60


def options(folder, scene="open_floor", moving="near"):
    return RunnerOptions(
        slot="none",
        scene=str(scene),
        moving=moving,
        policy="student",
        box=(0.3, 0.3, 0.25, 1.5),
        pose_port=1,
        tags_port=2,
        log=str(folder),
    )


class Recorded:
    """A runner that walks a simulated robot by itself, its log in a folder.

    `alter` changes entries on their way; None: the entry is lost. `ways`: of what moves in the scene of `asked`.
    """

    def __init__(self, folder, alter=lambda kind, entry: entry, asked=None, ways=None, **log):
        self.options = asked or options(folder)
        self.made = made = prepare(self.options, lambda stage: None)
        self.readings = []
        self.lab = lab = Lab(start="standing", noise="trained", scene=made.scene, motions_from_s=0.0)
        self.status, self.alter = np.zeros((), STATUS), alter
        about = {"options": self.options.text(), **digests(self.made)}
        with LogWriter(folder, "runner", kinds(width(made.policy), bool(made.moving)), about, **log) as writer:
            write = writer.write

            def altered(kind, time_s, entry):
                entry = self.alter(kind, entry)
                return entry is not None and write(kind, time_s, entry)

            writer.write = altered
            logged = RunnerLog(writer, lab.clock)
            sources = logged.source("pose", lab.poses), logged.source("tags", lab.tags)
            estimator = estimator_of(self.made, *sources)
            self.targets = []
            runner = RobotRunner(
                self.made.policy,
                self.made.pf,
                self.made.carry,
                estimator,
                logged.status_of(lambda: self.status if self.status["sequence"] else None),
                logged.put_of(lambda targets: self.targets.append(targets.copy())),
                logged,
                around_of(made, logged.source("movers", lab.movers), ways),
            )
            runner.warm()
            for i in range(TICKS):
                runner.tick()
                logged.after(runner)
                if runner.estimate is not None:
                    reading = read_fields(runner._fields, runner.estimate.percept, runner.policy.task)
                    self.readings.append(reading.vector)
                if ways is not None:
                    ways.wait()
                self._live(i)

    def _live(self, i):
        lab = self.lab
        if i < 10:
            lab.live(0.02)
        else:
            q = self.targets[-1]["q"]
            told = lab.holding()
            lab.live(0.02, command(q=np.clip(q, LIMITS.lower, LIMITS.upper), kp=told.kp, kd=told.kd))
        received = lab.link.state()
        self.status["mode"] = Mode.READY if i < 10 else Mode.CARRY
        self.status["sequence"], self.status["state"] = received.sequence, received.record


@pytest.fixture(scope="module")
def needed():
    pytest.importorskip("cv2", reason="tags need the extra `deploy`")


def test_the_same_bits_again(needed, tmp_path, capsys):
    recorded = Recorded(tmp_path)
    found = replay_log(tmp_path)
    assert main(["deploy", "replay", str(tmp_path)]) == 0
    said = capsys.readouterr().out
    assert f"{TICKS - 11} of {TICKS - 11} actions" in said and f"{TICKS - 1} of {TICKS - 1} targets" in said
    # the first tick found no status
    assert found.ticks == found.ticks_equal == len(recorded.targets) == TICKS - 1
    assert found.actions == found.actions_equal == TICKS - 11 and found.first_difference_s is None
    log = read_log(tmp_path, "runner")
    assert np.abs(log.entries["action"].records["values"]).max() > 0.1
    estimates = log.entries["estimate"].records
    assert len(estimates) == TICKS - 1 and (estimates["box_age_s"] < 0.2).all()


@pytest.mark.parametrize("moving", ["near", "live"])
def test_the_same_bits_again_among_what_moves(needed, tmp_path, moving):
    """Ways of the moment, which a process builds when it is ready, are in the log."""
    scene = Scene("walks", obstacles=walking_person("ann", [(1.1, -0.9), (1.1, 0.9)], 0.8))
    scene.save(tmp_path / "walks.json")
    asked = options(tmp_path, tmp_path / "walks.json", moving)
    with LiveWays(build_hod_pf(scene.still()), scene.moving) as ways:
        recorded = Recorded(tmp_path, asked=asked, ways=ways if moving == "live" else None)
    found, entries = replay_log(tmp_path), read_log(tmp_path, "runner").entries
    assert found.same and found.ticks == TICKS - 1 and found.actions > 30
    assert len(entries["movers"].records) == 11 and (entries["ways"].records["count"] == 2).all()
    assert len(entries["ways"].records) == (5 if moving == "live" else 0)
    ages = [float(targets["pose_age_s"]) for targets in recorded.targets[20:]]
    assert 0.09 < min(ages) and max(ages) < 0.25
    # pages and files of the run have the fields that the runner had
    run = read_run(tmp_path)
    assert len(run.readings) == len(recorded.readings) == TICKS - 1
    for ours, theirs in zip(run.readings, recorded.readings, strict=True):
        np.testing.assert_allclose(ours.vector, theirs, atol=1e-9)
    assert (run.moments["movers"][10:] == 2).all() and run.moments["movers_age_s"][10:].max() < 0.25
    told = [message for message in messages(run) if message.channel == "movers"]
    for message in told[5:]:
        # as she was when the robot's time was the same: she walks from its start on
        legs = scene.obstacles[0].at(message.time_s)
        np.testing.assert_allclose(message.said["poses"][0], [*legs.position_m, *legs.quaternion_wxyz], atol=0.02)
    assert len(told) > 50


def test_what_was_changed_comes_out_otherwise(needed, tmp_path, capsys):
    poses = []

    def alter(kind, entry):
        if kind == "pose":
            poses.append(entry)
            if len(poses) == 4:
                sample = PoseSample.decode(entry["sample"].tobytes())
                moved = replace(sample, p_ML=sample.p_ML + [1e-6, 0.0, 0.0])
                entry["sample"] = np.frombuffer(moved.encode(), entry["sample"].dtype)[0]
        return entry

    Recorded(tmp_path, alter)
    found = replay_log(tmp_path)
    assert found.ticks_equal < found.ticks and 0.3 <= found.first_difference_s <= 0.5
    assert found.actions == found.actions_equal
    assert main(["deploy", "replay", str(tmp_path)]) == 2
    assert "comes out otherwise, first at" in capsys.readouterr().err


def test_targets_that_the_runner_did_not_make_are_a_difference(needed, tmp_path, capsys):
    Recorded(tmp_path, lambda kind, entry: None if kind == "targets" and entry["number"] == 30 else entry)
    found = replay_log(tmp_path)
    assert found.ticks == found.ticks_equal == TICKS - 2 and 0.5 <= found.first_difference_s <= 0.7
    assert not found.same and main(["deploy", "replay", str(tmp_path)]) == 2


def test_a_log_with_nothing_to_compare_is_no_success(needed, tmp_path):
    Recorded(tmp_path, lambda kind, entry: entry if kind in ("pose", "tags") else None)
    with pytest.raises(InputError, match="nothing that can be made again"):
        replay_log(tmp_path)


def test_what_is_torn_is_told(needed, tmp_path):
    Recorded(tmp_path)
    path = tmp_path / "runner-000000.log"
    path.write_bytes(path.read_bytes()[:-100])
    told = []
    replay_log(tmp_path, told.append)
    assert any("hold no whole entry" in text for text in told)


def test_a_ring_gives_its_actions_again(needed, tmp_path):
    """Without its beginning the tracking is not known; from what the policy read come its actions."""
    Recorded(tmp_path, segment_s=0.2)
    first = tmp_path / "runner-000000.log"
    assert len(list(tmp_path.iterdir())) > 3
    first.unlink()
    found = replay_log(tmp_path)
    assert found.ticks == 0 and found.actions == found.actions_equal > 20


def test_another_policy_is_refused(needed, tmp_path, monkeypatch):
    Recorded(tmp_path)
    monkeypatch.setattr(
        "hotice.deploy.recording.replay.digests", lambda made: {"policy": "another", "scene": digests(made)["scene"]}
    )
    with pytest.raises(InputError, match="the policy is another one"):
        replay_log(tmp_path)


def test_what_a_guard_logs(tmp_path, rng):
    clock = SimulatedClock()
    bus = MemoryBus(clock)
    robot = bus.robot()
    with LogWriter(tmp_path, "guard", KINDS) as writer:
        link = GuardLog(bus.link(), writer, clock)
        newest = np.zeros((), TARGETS)

        class Slot:
            def targets(self):
                return newest

            def tell(self, status):
                self.told = status

        slot = LoggedSlot(Slot(), writer)
        for i in range(3):
            record = low_state(rng, tick=2 * i + 2)
            robot.publish_state(record)
            clock.sleep(0.002)
            for _ in range(2):
                assert link.state().sequence == i + 1
            link.publish(command(kd=np.full(29, 2.0), tau=np.full(29, 0.5 * i)))
            newest["number"], newest["stamp_s"] = i // 2 + 1, clock.now()
            assert slot.targets() is newest
        link.event(Event(clock.now(), Mode.DAMPING, Cause.LEAN, "the pelvis leans too far"))
    entries = read_log(tmp_path, "guard").entries
    assert entries["state"].records["tick"].tolist() == [2, 4, 6]
    assert entries["command"].records["motor_cmd"]["tau"][:, JOINTS][:, 3].tolist() == [0.0, 0.5, 1.0]
    assert (entries["command"].records["mode_machine"] == 5).all()
    assert entries["targets"].records["number"].tolist() == [1, 2]
    assert json.loads(entries["event"].records[0]) == {
        "mode": "DAMPING",
        "cause": "LEAN",
        "text": "the pelvis leans too far",
    }


def test_rings_lie_in_the_users_cache_and_few_are_kept(tmp_path, monkeypatch):
    monkeypatch.setenv(VARIABLE, str(tmp_path))
    robot = tmp_path / "logs" / "lo-1"
    for i in range(KEPT + 3):
        (robot / f"20260101-00000{i}-1").mkdir(parents=True)
    (robot / "mine").mkdir()
    tmp_path.joinpath("logs").chmod(0o700)
    made = ring_folder("lo-1")
    assert made.parent == robot and made.is_dir() and made.name.endswith(f"-{os.getpid()}")
    names = sorted(path.name for path in robot.iterdir())
    assert len(names) == KEPT + 1 and "mine" in names and "20260101-000007-1" in names
    assert time.strftime("%Y") in made.name
