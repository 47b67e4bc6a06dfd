"""A simulated robot in lock step that stands, then walks, its poses true: its live frames, and the page of its log."""

import json
import socket

import numpy as np
import pytest

from hotice.deploy.command import LIMITS
from hotice.deploy.estimate import TrackingEstimator
from hotice.deploy.guard.modes import Mode
from hotice.deploy.log.writer import LogWriter
from hotice.deploy.messages.hg import JOINTS
from hotice.deploy.recording import RunnerLog
from hotice.deploy.recording.replay import digests
from hotice.deploy.recording.runner_log import kinds, width
from hotice.deploy.runner import RobotRunner
from hotice.deploy.seeing import read_run, rollout_record
from hotice.deploy.seeing.live_frames import Painter, about_run
from hotice.deploy.seeing.live_view import MomentSender
from hotice.deploy.seeing.moments import MOMENT
from hotice.deploy.slot.records import STATUS
from hotice.model import builder, g1
from tests.deploy.seeing_fixture import OPTIONS, made
from tests.deploy.simulated_fixture import Lab, command

TICKS, STANDS = 60, 15


class Watched:
    """The robot's life: its log in a folder, its frames, and where pelvis and object truly were at each tick."""

    def __init__(self, folder):
        lab = self.lab = Lab(start="standing", scene=made().pf.scene)
        status, targets = np.zeros((), STATUS), []
        self.frames, self.truth, self.joints = [], [], []
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        sender = MomentSender(ours)
        painter = Painter(about_run(made().pf.scene, made().carry.carried, made().policy))
        about = {"options": OPTIONS.text(), **digests(made())}
        with LogWriter(folder, "runner", kinds(width(made().policy)), about) as log:
            logged = RunnerLog(log, lab.clock)
            runner = RobotRunner(
                made().policy,
                made().pf,
                made().carry,
                TrackingEstimator(made().carry.carried, self.lab.pelvis, self.lab.box),
                logged.status_of(lambda: status if status["sequence"] else None),
                logged.put_of(lambda t: targets.append(t.copy())),
                logged,
            )
            runner.warm()
            for i in range(TICKS):
                self.truth.append(
                    [lab.world.data.body(name).xpos.copy() for name in (g1.ROOT_BODY, builder.OBJECT_BODY)]
                )
                self.joints.append(status["state"]["motor_state"]["q"][JOINTS].copy())
                runner.tick()
                logged.after(runner)
                sender.after(runner)
                self._draw(theirs, painter, i)
                told = lab.holding()
                walks = i >= STANDS
                if walks:
                    q = np.clip(targets[-1]["q"], LIMITS.lower, LIMITS.upper)
                    told = command(q=q, kp=told.kp, kd=told.kd)
                lab.live(0.02, told)
                received = lab.link.state()
                status["mode"], status["sequence"] = Mode.CARRY if walks else Mode.READY, received.sequence
                status["received_s"], status["state"] = received.received_s, received.record
        ours.close()
        theirs.close()

    def _draw(self, theirs, painter, tick):
        try:
            data = theirs.recv(MOMENT.itemsize, socket.MSG_DONTWAIT)
        except BlockingIOError:
            return
        self.frames.append((tick, painter.frame(np.frombuffer(data, MOMENT)[0])))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("log")


@pytest.fixture(scope="module")
def watched(folder):
    return Watched(folder)


def test_every_third_tick_is_shown_where_the_robot_is(watched):
    # the first tick found no status
    ticks = [tick for tick, _ in watched.frames]
    assert ticks == list(range(1, TICKS, 3))
    for tick, frame in watched.frames:
        pelvis, box = watched.truth[tick]
        # tracking smooths
        np.testing.assert_allclose(frame["root_pos"], pelvis, atol=0.02)
        np.testing.assert_allclose(frame["object_pos"], box, atol=0.02)
    assert [event["text"] for event in watched.frames[-1][1]["events"]] == ["ready: none", "carry: none"]
    assert json.dumps(watched.frames[-1][1], allow_nan=False)


def test_the_log_shows_the_same(watched, folder):
    run = read_run(folder)
    record = rollout_record(run)
    assert len(record.time_s) == TICKS - 1
    for tick, frame in watched.frames:
        np.testing.assert_allclose(record.root_pos_W[tick - 1], frame["root_pos"], atol=1e-4)
        np.testing.assert_allclose(record.geom_pos_W[tick - 1].ravel(), frame["geom_pos"], atol=1e-4)
        np.testing.assert_allclose(record.arrow_force_W[tick - 1].ravel(), frame["arrow_force"], atol=1e-4)
    np.testing.assert_array_equal(run.moments["joint_pos"][10], watched.joints[11])
    assert [event.text for event in record.events] == ["ready: none", "carry: none"]
    assert record.root_pos_W[-1, 0] - record.root_pos_W[0, 0] > 0.02
