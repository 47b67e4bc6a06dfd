"""A run from its log: where robot and object were, what guided, what happened when; and its page."""

import json
import re

import mujoco
import numpy as np
import pytest

from hotice.commands.program import main
from hotice.deploy.log.writer import LogWriter
from hotice.deploy.seeing import read_run, rollout_record
from hotice.errors import InputError
from hotice.model import builder, g1
from hotice.replay import RolloutEvent, write_html
from tests.deploy.seeing_fixture import BLIND, BOX, START_S, TICKS, robot_at, solved, write_run

FRAMES = TICKS - BLIND


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
    np.testing.assert_allclose(moments["time_s"], START_S + 0.02 * np.arange(BLIND, TICKS))
    np.testing.assert_allclose(moments["late_s"], 0.0001 * np.arange(BLIND, TICKS))
    np.testing.assert_allclose(moments["state_age_s"], 0.004, atol=1e-9)
    np.testing.assert_allclose(moments["estimate"]["box_age_s"], 0.02 * np.arange(BLIND, TICKS))
    assert set(moments["estimate"]["box_verdict"]) == {b"hidden"}
    assert moments["guided"].tolist() == [0] * (30 - BLIND) + [1] * (TICKS - 30)
    assert len(run.targets.records) == TICKS


def test_every_solid_is_where_it_was(record):
    """Against MuJoCo's kinematics of the true states; joint angles are single precision in the messages."""
    model = builder.build_model(solved(BOX).carried, joints=29, floor=False)
    data = mujoco.MjData(model)
    assert len(record.time_s) == FRAMES
    for frame in (0, 40, FRAMES - 1):
        data.qpos[:] = robot_at(frame + BLIND).to_mujoco(29)[0]
        mujoco.mj_kinematics(model, data)
        for g, name in enumerate(record.geom_names):
            np.testing.assert_allclose(record.geom_pos_W[frame, g], data.geom(name).xpos, atol=1e-6)
        np.testing.assert_allclose(record.root_pos_W[frame], data.body(g1.ROOT_BODY).xpos, atol=1e-9)
        np.testing.assert_allclose(record.object_pos_W[frame], data.body(builder.OBJECT_BODY).xpos, atol=1e-9)


def test_arrows_are_where_keypoints_were(record, run):
    assert record.arrow_is_ogf.tolist() == [False] * 9 + [True] * 10
    head = g1.SGF_KEYPOINTS.index("head")
    np.testing.assert_array_equal(record.arrow_pos_W[5, head], run.moments["estimate"]["percept"]["p_WK"][5, head])
    assert (record.arrow_force_W[: 30 - BLIND] == 0.0).all()
    np.testing.assert_allclose(record.arrow_force_W[30 - BLIND :, 7, 2], 0.01 * np.arange(30, TICKS))


def test_modes_and_faults_are_events(record):
    assert record.events == (
        RolloutEvent(time_s=999.5, kind="mode", text="damping: start"),
        RolloutEvent(time_s=1000.5, kind="mode", text="carry: carry"),
        RolloutEvent(time_s=1001.0, kind="fault", text="hold: the box was not seen for 2.1 s"),
        RolloutEvent(time_s=1001.0, kind="mode", text="hold: the box was not seen for 2.1 s"),
        RolloutEvent(time_s=1001.2, kind="note", text="lower: not now"),
        RolloutEvent(time_s=1001.5, kind="mode", text="damping: leans by 1.1 rad"),
    )
    assert record.outcome == "fall"


def test_the_page_has_frames_and_events(record, tmp_path):
    text = write_html([record], tmp_path / "page.html").read_text(encoding="utf-8")
    (shown,) = json.loads(re.search(r'id="data">(.*?)</script>', text, re.S)[1])["records"]
    assert [round(e["time"], 6) for e in shown["events"]] == [-0.7, 0.3, 0.8, 0.8, 1.0, 1.3]
    assert shown["time"][-1] == pytest.approx(0.02 * (FRAMES - 1))


def test_the_command_writes_both_files(folder, tmp_path, capsys):
    page, bag = tmp_path / "page.html", tmp_path / "run.mcap"
    assert main(["robot-replay", str(folder), "--html", str(page)]) == 0
    said = capsys.readouterr().out
    assert f"gap, student: {FRAMES} moments in 1.78 s, 6 events" in said and str(page) in said
    assert "leans by 1.1 rad" in page.read_text(encoding="utf-8")
    assert main(["robot-replay", str(folder)]) == 2
    assert "give --html page.html, --mcap run.mcap or both" in capsys.readouterr().err
    assert main(["robot-replay", str(tmp_path / "none"), "--html", str(page)]) == 2
    assert "no such folder" in capsys.readouterr().err
    pytest.importorskip("mcap")
    assert main(["robot-replay", str(folder), "--mcap", str(bag)]) == 0
    assert bag.read_bytes().startswith(b"\x89MCAP0")


def test_without_a_guard_s_log_the_runner_s_modes_are_told(tmp_path):
    run = read_run(write_run(tmp_path, guard=False))
    told = [(round(t - START_S, 6), event.mode, event.cause) for t, event in run.events]
    assert told == [
        (0.0, "damping", "operator"),
        (0.5, "carry", "operator"),
        (1.0, "hold", "box unseen"),
        (1.5, "damping", "lean"),
    ]


def test_what_cannot_be_shown_is_said(tmp_path):
    with pytest.raises(InputError, match="holds no log of 'runner'"):
        read_run(tmp_path)
    with pytest.raises(InputError, match="never knew where it was"):
        read_run(write_run(tmp_path / "blind", blind=TICKS))
    with pytest.raises(InputError, match="says what is not possible: .*format"):
        read_run(write_run(tmp_path / "scene", scene={"format": "other"}))
    with LogWriter(tmp_path / "bare", "runner", {"note": None}, {"policy": "student"}):
        pass
    with pytest.raises(InputError, match="does not say its scene"):
        read_run(tmp_path / "bare")
