"""A run from its log: where robot and object were, what guided, what happened when; and its page."""

import json
import re
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from hotice.commands.program import main
from hotice.deploy.log.writer import LogWriter
from hotice.deploy.seeing import read_run, rollout_record
from hotice.deploy.seeing.recorded import LoggedEvent
from hotice.deploy.seeing.rollout import outcome_of, shown_events
from hotice.errors import InputError
from hotice.model import builder, g1
from hotice.replay import RolloutEvent, write_html
from tests.deploy.seeing_fixture import (
    BLIND,
    BOX,
    DROPPED,
    LATE,
    START_S,
    TICKS,
    estimate_at,
    made,
    robot_at,
    solved,
    time_of,
    write_run,
)

SHOWN = [i for i in range(BLIND, TICKS) if i != DROPPED]
FRAMES = len(SHOWN)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return write_run(tmp_path_factory.mktemp("log"))


@pytest.fixture(scope="module")
def run(folder):
    return read_run(folder)


@pytest.fixture(scope="module")
def record(run):
    return rollout_record(run)


def test_the_run_says_what_it_was(run):
    assert (run.scene.name, run.policy, run.object_field, run.carried.mass_kg) == ("gap", "student", "ogf", 1.5)
    moments = run.moments
    np.testing.assert_array_equal(moments["time_s"], [time_of(i) for i in SHOWN])
    np.testing.assert_allclose(moments["late_s"], [0.005 * (i == LATE) for i in SHOWN], atol=1e-9)
    np.testing.assert_allclose(moments["state_age_s"], 0.004, atol=1e-9)
    np.testing.assert_allclose(moments["box_age_s"], [0.02 * i for i in SHOWN])
    assert set(moments["pose_age_s"]) == {0.1} and not moments["disputed"].any()
    assert len(run.targets.records) == TICKS


def test_every_solid_is_where_it_was(record):
    """Against MuJoCo's kinematics of the true states; joint angles are single precision in the messages."""
    model = builder.build_model(solved(BOX).carried, joints=29, floor=False)
    data = mujoco.MjData(model)
    assert len(record.time_s) == FRAMES
    for frame in (0, 42, FRAMES - 1):
        data.qpos[:] = robot_at(SHOWN[frame]).to_mujoco(29)[0]
        mujoco.mj_kinematics(model, data)
        for g, name in enumerate(record.geom_names):
            np.testing.assert_allclose(record.geom_pos_W[frame, g], data.geom(name).xpos, atol=1e-6)
        np.testing.assert_allclose(record.root_pos_W[frame], data.body(g1.ROOT_BODY).xpos, atol=1e-9)
        np.testing.assert_allclose(record.object_pos_W[frame], data.body(builder.OBJECT_BODY).xpos, atol=1e-9)


def test_arrows_are_where_keypoints_were(record, run):
    assert record.arrow_is_ogf.tolist() == [False] * 9 + [True] * 10
    percept = estimate_at(SHOWN[5]).percept
    head = g1.SGF_KEYPOINTS.index("head")
    np.testing.assert_array_equal(record.arrow_pos_W[5, head], percept.p_WK[head])
    np.testing.assert_array_equal(record.arrow_pos_W[5, 11:], percept.p_WOK)
    for field, arrows in ((made().pf.sgf, slice(0, 9)), (made().pf.ogf, slice(9, 19))):
        points = record.arrow_pos_W[5, arrows]
        np.testing.assert_allclose(record.arrow_force_W[5, arrows], field.sample(points), atol=1e-5)
    assert np.linalg.norm(record.arrow_force_W[5], axis=1).min() > 0.01


def test_modes_and_faults_are_events(record):
    assert record.events == (
        RolloutEvent(time_s=999.5, kind="mode", text="damping: start"),
        RolloutEvent(time_s=1000.5, kind="mode", text="carry: carry"),
        RolloutEvent(time_s=1001.0, kind="fault", text="hold: the box was not seen for 2.1 s"),
        RolloutEvent(time_s=1001.0, kind="fault", text="hold: the box was not seen for 2.1 s"),
        RolloutEvent(time_s=1001.2, kind="note", text="lower: not now"),
        RolloutEvent(time_s=1001.5, kind="fault", text="damping: leans by 1.1 rad"),
    )
    assert record.outcome == "fall"


@pytest.mark.parametrize(
    ("told", "outcome"),
    [
        ([("damping", "operator"), ("posture", "operator"), ("ready", "done")], "running"),
        ([("ready", "done"), ("carry", "operator"), ("hold", "done"), ("damping", "lean")], "success"),
        ([("ready", "done"), ("damping", "state age"), ("damping", "lean")], "running"),
        ([("carry", "operator"), ("hold", "box unseen"), ("damping", "joint speed")], "fall"),
        ([("carry", "operator"), ("damping", "operator"), ("damping", "lean")], "running"),
        ([("damping", "lean"), ("posture", "operator")], "running"),
        ([], "running"),
    ],
)
def test_the_outcome_is_that_of_the_change_that_decides(told, outcome):
    """Reaching the posture is no success, and a robot that brakes already may lean, also at a ring's beginning."""
    assert outcome_of([(float(i), LoggedEvent(*each, "")) for i, each in enumerate(told)]) == outcome


def test_a_ring_may_begin_with_a_fault_that_was_told():
    told = [("damping", "lean", "damping: leans by 1.1 rad"), ("posture", "operator", "posture")]
    events = shown_events([(float(i), LoggedEvent(*each)) for i, each in enumerate(told)])
    assert [(each.kind, each.text) for each in events] == [
        ("fault", "damping: leans by 1.1 rad"),
        ("mode", "posture: posture"),
    ]


def test_a_time_at_which_nothing_was_known_is_told(run):
    """The page moves the robot evenly over it."""
    known = [i for i in range(FRAMES) if not 30 <= i < 45]
    events = rollout_record(replace(run, moments=run.moments[known], readings=[run.readings[i] for i in known])).events
    (told,) = [event for event in events if "not known" in event.text]
    assert (told.kind, told.text) == ("fault", "robot or box not known for 0.34 s")
    assert told.time_s == time_of(SHOWN[29]) and list(events) == sorted(events, key=lambda event: event.time_s)


def test_the_page_has_frames_and_events(record, tmp_path):
    text = write_html([record], tmp_path / "page.html").read_text(encoding="utf-8")
    (shown,) = json.loads(re.search(r'id="data">(.*?)</script>', text, re.S)[1])["records"]
    assert [round(e["time"], 6) for e in shown["events"]] == [-0.7, 0.3, 0.8, 0.8, 1.0, 1.3]
    assert shown["time"][-1] == pytest.approx(1.785)


def test_the_command_writes_both_files(folder, tmp_path, capsys):
    page, bag = tmp_path / "page.html", tmp_path / "run.mcap"
    assert main(["deploy", "replay", str(folder), "--html", str(page)]) == 0
    said = capsys.readouterr().out
    assert f"gap, student: {FRAMES} moments in 1.78 s, 6 events" in said and str(page) in said
    assert "leans by 1.1 rad" in page.read_text(encoding="utf-8")
    assert main(["deploy", "replay", str(tmp_path / "none"), "--html", str(page)]) == 2
    assert "no such folder" in capsys.readouterr().err
    pytest.importorskip("mcap")
    assert main(["deploy", "replay", str(folder), "--mcap", str(bag)]) == 0
    assert bag.read_bytes().startswith(b"\x89MCAP0")


def test_without_a_guard_s_log_the_runner_s_modes_are_told(tmp_path):
    run = read_run(write_run(tmp_path, guard=False))
    told = [(round(t - START_S, 6), event.mode, event.cause) for t, event in run.events]
    assert told == [
        (0.0, "damping", "operator"),
        (0.5, "carry", "operator"),
        (1.02, "hold", "box unseen"),
        (1.505, "damping", "lean"),
    ]


def test_what_cannot_be_shown_is_said(tmp_path):
    with pytest.raises(InputError, match="holds no log of 'runner'"):
        read_run(tmp_path)
    with pytest.raises(InputError, match="never knew where it was"):
        read_run(write_run(tmp_path / "blind", blind=TICKS))
    with pytest.raises(InputError, match="scene is another one"):
        read_run(write_run(tmp_path / "scene", scene="0" * 64))
    with LogWriter(tmp_path / "bare", "runner", {"note": None}, {"policy": "student"}):
        pass
    with pytest.raises(InputError, match="does not say what was run"):
        read_run(tmp_path / "bare")
