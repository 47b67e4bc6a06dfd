"""The live page: frames with right numbers, a server for this machine alone, a sender that never waits."""

import http.client
import json
import os
import re
import socket
import threading
from contextlib import contextmanager
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest

from hotice.deploy.guard.scheduling import give_way, take_precedence
from hotice.deploy.seeing import LiveView, moment
from hotice.deploy.seeing.live_frames import Painter, about_run
from hotice.deploy.seeing.live_server import receive
from hotice.deploy.seeing.live_view import NICE, MomentSender
from hotice.deploy.seeing.moments import MOMENT
from hotice.errors import HoticeError
from hotice.model import Obstacle, Scene, builder, g1, load_scene
from hotice.model.geometry.shapes import MeshShape
from hotice.policy import PolicyTask, read_fields
from hotice.replay import write_html
from hotice.replay.html import live_page
from hotice.replay.serving import MOST_READERS, LiveServer, Newest
from tests.deploy.seeing_fixture import (
    BOX,
    START_S,
    STEP_S,
    estimate_at,
    made,
    robot_at,
    solved,
    status_at,
)


@pytest.fixture(scope="module")
def about():
    return about_run(load_scene("gap"), solved(BOX).carried, made().policy)


@pytest.fixture
def painter(about):
    return Painter(about)


def moment_at(i, late_s=0.002):
    return moment(status_at(i), estimate_at(i), time_s=START_S + STEP_S * i, late_s=late_s)


@contextmanager
def served(page="<p>", **options):
    newest = Newest()
    server = LiveServer(page, newest, **options)
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    try:
        yield server, newest
    finally:
        newest.end()
        server.shutdown()
        server.server_close()
        thread.join()


def asked(server, path="/", host=None):
    connection = http.client.HTTPConnection(*server.server_address[:2], timeout=20)
    connection.request("GET", path, headers={} if host is None else {"Host": host})
    return connection.getresponse()


def test_a_frame_has_every_solid_where_it_is(painter):
    frame, names = painter.frame(moment_at(40)), painter.first().geom_names
    data = mujoco.MjData(builder.build_model(solved(BOX).carried, joints=29, floor=False))
    data.qpos[:] = robot_at(40).to_mujoco(29)[0]
    mujoco.mj_kinematics(data.model, data)
    placed = [data.geom(name).xpos for name in names]
    np.testing.assert_allclose(np.reshape(frame["geom_pos"], (-1, 3)), placed, atol=1e-4)
    np.testing.assert_allclose(frame["root_pos"], [0.4, -0.2, 0.75])
    reading = read_fields(made().pf, estimate_at(40).percept, PolicyTask.from_meta(made().policy.meta))
    np.testing.assert_allclose(np.reshape(frame["arrow_force"], (-1, 3)), reading.force_W, atol=1e-4)
    facts = {name: text for name, text, _ in frame["facts"]}
    assert facts["Command"] == "{:.2f}, {:.2f}, {:.2f} m/s".format(*reading.c_W)
    assert facts["Nearest"] == f"{reading.distance.min():.2f} m"
    head = g1.SGF_KEYPOINTS.index("head")
    np.testing.assert_allclose(
        frame["arrow_pos"][3 * head : 3 * head + 3], estimate_at(40).percept.p_WK[head], atol=1e-4
    )


def test_a_scene_with_meshes_is_shown(tmp_path):
    """What it is about goes through JSON to another process; the meshes' files are found there."""
    (tmp_path / "wedge.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n")
    wedge = Obstacle("wedge", "side", MeshShape("wedge.obj", 0.3, tmp_path), (1.3, 0.9, 0.0))
    scene = Scene("wedge", obstacles=(wedge,))
    painter = Painter(json.loads(json.dumps(about_run(scene, solved(BOX).carried, made().policy))))
    (obstacle,) = painter.first().scene.obstacles
    np.testing.assert_allclose(obstacle.shape.mesh().vertices.max(axis=0), 0.3)


def test_a_frame_says_ages_lateness_and_mode(painter):
    early = painter.frame(moment_at(12))
    facts = {name: (text, bad) for name, text, bad in early["facts"]}
    assert (early["time"], early["mode"]) == (0.0, "damping")
    assert facts["State"] == ("4 ms", False) and facts["Runner late"] == ("2.0 ms", False)
    assert facts["Localization"] == ("100 ms, ok", False) and facts["Box"] == ("240 ms, hidden", False)
    shown = moment_at(99, late_s=0.025)
    shown["box_age_s"], shown["pose_age_s"] = np.inf, 1.2
    shown["state_age_s"], shown["disputed"] = 0.06, 1
    late = painter.frame(shown)
    facts = {name: (text, bad) for name, text, bad in late["facts"]}
    assert late["time"] == pytest.approx(1.74) and late["mode"] == "damping"
    assert facts["Box"] == ("never, hidden", True) and facts["Localization"] == ("1.2 s, disputed", True)
    assert facts["State"] == ("60 ms", True) and facts["Runner late"] == ("25.0 ms", True)
    goal = made().pf.scene.goal
    assert facts["To the goal"] == (f"{np.hypot(goal[0] - 0.99, goal[1] + 0.2):.2f} m", False)
    assert facts["Command"] == ("none", False)
    json.dumps(late, allow_nan=False)


def test_changes_of_mode_are_events(painter):
    frames = [painter.frame(moment_at(i)) for i in range(100)]
    told = [(event["time"], event["kind"], event["text"]) for event in frames[-1]["events"]]
    assert told == [
        (0.0, "mode", "damping: operator"),
        (0.5, "mode", "carry: operator"),
        (1.0, "fault", "hold: box unseen"),
        (1.5, "fault", "damping: lean"),
    ]
    assert [len(frame["events"]) for frame in frames[::25]] == [1, 2, 3, 4]


def test_a_robot_that_is_not_known_has_no_place(painter):
    """Neither before it was seen, nor with numbers that are none; mode and ages are shown all the same."""
    broken = moment_at(40)
    broken["percept"]["p_WO"][1] = np.nan
    unseen = moment(status_at(41), None, time_s=START_S + STEP_S * 41)
    for frame in (painter.frame(broken), painter.frame(unseen)):
        assert frame.keys() == {"time", "mode", "facts", "events"} and frame["mode"] == "carry"
        assert [fact for fact in frame["facts"] if fact[2]] == [("Robot and box", "not known yet", True)]
        assert ("State", "4 ms", False) in frame["facts"]
        json.dumps(frame, allow_nan=False)


def test_a_state_that_never_came_has_no_age(painter):
    status = status_at(0)
    status["sequence"] = status["received_s"] = 0
    assert ("State", "never", True) in painter.frame(moment(status, None, time_s=START_S))["facts"]


def test_a_slow_reader_misses_frames():
    newest = Newest()
    for i in range(5):
        newest.put({"i": i})
    assert newest.after(0, 0.0) == (5, '{"i":4}')
    assert newest.after(5, 0.0) == (5, None)
    newest.end()
    assert newest.after(5, 60.0) == (5, None)


def test_the_sender_drops_what_nobody_takes_and_survives_the_end():
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    sender = MomentSender(ours)
    taken = [sender.show(moment_at(3 * i)) for i in range(30)]
    assert taken[0] and not taken[-1] and sender.dropped == 30 - sum(taken) > 20
    assert np.frombuffer(theirs.recv(MOMENT.itemsize), MOMENT)[0] == moment_at(0)
    theirs.close()
    assert not sender.show(moment_at(99)) and not sender.show(moment_at(200))


def test_twenty_moments_a_second_are_sent_at_most():
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    sender = MomentSender(ours)
    sent = []
    for i in range(50):
        sent.append(sender.show(moment_at(i)))
        if sent[-1]:
            theirs.recv(MOMENT.itemsize)
    assert sent == [i % 3 == 0 for i in range(50)] and sender.dropped == 0
    ours.close()
    theirs.close()


def test_a_late_tick_is_shown_by_the_next_moment():
    """Two of three ticks are not shown; what they were late is."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    sender, shown = MomentSender(ours), []
    for i in range(10):
        began_s = START_S + STEP_S * i + (0.015 if i == 4 else 0.0)
        runner = SimpleNamespace(began_s=began_s, period_s=STEP_S, status=status_at(i), estimate=None, around=None)
        sender.after(runner)
        if i % 3 == 0:
            shown.append(float(np.frombuffer(theirs.recv(MOMENT.itemsize), MOMENT)[0]["late_s"]))
    np.testing.assert_allclose(shown, [0.0, 0.0, 0.015, 0.0], atol=1e-9)
    ours.close()
    theirs.close()


def test_the_last_of_several_moments_is_drawn(painter):
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    for i in (30, 31, 32):
        ours.send(moment_at(i).tobytes())
    ours.close()
    newest = Newest()
    receive(theirs, painter, newest)
    number, text = newest.after(0, 0.0)
    assert number == 1 and json.loads(text)["root_pos"][0] == pytest.approx(0.32) and newest.over


def test_the_page_and_its_frames():
    with served("<p>page</p>") as (server, newest):
        assert re.fullmatch(r"http://127\.0\.0\.1:\d+/", server.url)
        response = asked(server)
        assert (response.status, response.read()) == (200, b"<p>page</p>")
        newest.put({"time": 1})
        stream = asked(server, "/events")
        assert stream.getheader("Content-Type") == "text/event-stream"
        assert stream.readline() == b'data: {"time":1}\n'
        newest.put({"time": 2})
        lines = iter(stream.readline, b"")
        assert next(line for line in lines if line.startswith(b"data")) == b'data: {"time":2}\n'
        newest.end()
        assert [line for line in lines if line.startswith(b"event")] == [b"event: over\n"]


def test_other_names_and_paths_are_refused():
    """A page of another site whose name leads to 127.0.0.1 must not read the robot."""
    with served() as (server, _):
        port = server.server_address[1]
        assert asked(server, host=f"evil.example:{port}").status == 403
        assert asked(server, "/events", host="evil.example").status == 403
        assert asked(server, host=f"localhost:{port}").status == 200
        assert asked(server, "/../etc/passwd").status == 404
        with pytest.raises(HoticeError, match=f"127.0.0.1:{port} cannot be used .* choose another port"):
            LiveServer("", Newest(), port=port)


def test_readers_are_counted():
    with served() as (server, newest):
        newest.put({})
        streams = [asked(server, "/events") for _ in range(MOST_READERS)]
        assert [stream.readline() for stream in streams] == MOST_READERS * [b"data: {}\n"]
        assert asked(server, "/events").status == 503


def test_only_the_live_page_may_connect_and_only_to_its_server(painter, tmp_path):
    record = painter.first()
    live, still = live_page(record, "events"), write_html([record], tmp_path / "p.html").read_text(encoding="utf-8")
    assert "connect-src 'self'" in live and "connect-src 'none'" in still
    pages = [json.loads(re.search(r'id="data">(.*?)</script>', text, re.S)[1]) for text in (live, still)]
    assert [page["live"] for page in pages] == ["events", None]
    assert (
        len(pages[0]["records"][0]["time"]) == 1 and pages[0]["records"][0]["arrow_is_ogf"] == [False] * 9 + [True] * 10
    )


@pytest.mark.slow
def test_a_page_of_its_own_process():
    """It has no precedence, its frames come, a port that is taken is told, and it ends with its runner."""
    first = take_precedence()
    try:
        view = LiveView(made().pf.scene, solved(BOX).carried, made().policy)
    finally:
        if first:
            give_way()
    with view:
        pid = view._process.pid
        assert os.sched_getscheduler(pid) == os.SCHED_OTHER and os.getpriority(os.PRIO_PROCESS, pid) == NICE
        host, port = re.fullmatch(r"http://(127\.0\.0\.1):(\d+)/", view.url).groups()
        connection = http.client.HTTPConnection(host, int(port), timeout=60)
        connection.request("GET", "/")
        assert b'"gap"' in connection.getresponse().read()
        connection.request("GET", "/events")
        stream = connection.getresponse()
        assert view.show(moment_at(40)) and not view.show(moment_at(41))
        line = next(line for line in iter(stream.readline, b"") if line.startswith(b"data"))
        frame = json.loads(line.removeprefix(b"data: "))
        assert frame["root_pos"] == [0.4, -0.2, 0.75] and frame["mode"] == "carry"
        with pytest.raises(HoticeError, match="cannot be used for the live page"):
            LiveView(made().pf.scene, solved(BOX).carried, made().policy, port=int(port))
    assert view._process.returncode == 0
    assert b"event: over\n" in list(iter(stream.readline, b""))
    assert not view.show(moment_at(60))
