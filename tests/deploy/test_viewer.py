"""What the pages' scripts show, run by node with three.js itself, but without a browser."""

import json
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from hotice.deploy.seeing import moment
from hotice.deploy.seeing.live_frames import Painter, about_run
from hotice.fields import build_hod_pf
from hotice.fields.moving.momentary import momentary_pf, poses_of
from hotice.model import BoxShape, Obstacle, Scene
from hotice.model.moving import walking_person
from hotice.policy import PolicyTask, read_fields
from hotice.replay import RolloutEvent, write_html
from hotice.replay.html import live_page
from tests.deploy.seeing_fixture import START_S, STEP_S, estimate_at, made, status_at

pytestmark = pytest.mark.skipif(shutil.which("node") is None, reason="node is not installed")
HARNESS = Path(__file__).parents[1] / "replay" / "viewer_in_node.js"


def shown(*files):
    done = subprocess.run(["node", HARNESS, *files], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.fixture(scope="module")
def painter():
    return Painter(about_run(made().pf.scene, made().carry.carried, made().policy))


def apart(solids, placed):
    """Largest distance from where a solid should be to the nearest that is shown [m]."""
    every = np.array(solids)
    return max(np.linalg.norm(every - p, axis=1).min() for p in np.reshape(placed, (-1, 3)))


def test_a_robot_that_lives(painter, tmp_path):
    page, told = tmp_path / "live.html", tmp_path / "frames.json"
    page.write_text(live_page(painter.first(), "events"), encoding="utf-8")
    moments = [moment(status_at(i), estimate_at(i), time_s=START_S + STEP_S * i, late_s=0.02) for i in range(0, 91, 3)]
    unknown = painter.frame(moment(status_at(0), None, time_s=START_S - 0.1))
    frames = [painter.frame(each) for each in moments]
    told.write_text(json.dumps([unknown]))
    blind = shown(page, told)[1]
    assert blind["badge"] == "damping" and blind["marked"] == ["Robot and box"] and blind["trails"] == [0, 0]
    told.write_text(json.dumps([unknown, *frames]))
    waiting, living, silent, over = shown(page, told)
    assert len(blind["solids"]) == len(waiting["solids"])
    assert (waiting["badge"], waiting["beside"], waiting["story"]) == ("waiting", "nothing has come yet", False)
    assert (living["badge"], living["beside"]) == ("damping", "1.90 s")
    # the robot is not there before its first frame
    count = len(frames[0]["geom_pos"]) // 3
    assert len(living["solids"]) == len(waiting["solids"]) + count
    assert apart(living["solids"], frames[-1]["geom_pos"]) < 1e-6
    assert living["trails"] == [len(frames), len(frames)]
    facts = {name: text for name, text, _ in frames[-1]["facts"]}
    assert facts.items() <= living["facts"].items() and living["facts"]["Policy"] == "student"
    assert living["marked"] == ["Runner late"]
    assert living["events"] == [f"{e['time']:.2f} s  {e['text']}" for e in frames[-1]["events"]]
    assert living["events"][1] == "0.64 s  carry: operator"
    # ARROW_M (1 - exp(-|F| / FIELD_SCALE)) along F, from the first keypoint
    force = np.array(frames[-1]["arrow_force"][:3])
    length = 0.3 * (1.0 - np.exp(-np.linalg.norm(force) / 0.6))
    tip = np.array(frames[-1]["arrow_pos"][:3]) + length * force / np.linalg.norm(force)
    np.testing.assert_allclose(living["arrow"], tip, atol=1e-5)
    assert (silent["badge"], silent["beside"]) == ("no news", "last damping, 0.8 s ago")
    assert (over["badge"], over["open"]) == ("over", False)


def test_obstacles_that_move_are_where_they_are_seen(tmp_path):
    """Not there before that; arrows are of the fields with them, where they are then."""
    post = Obstacle("post", "side", BoxShape((0.2, 0.2, 1.0)), (0.8, 0.7, 0.5))
    legs, trunk = walking_person("ann", [(1.3, -0.9), (1.3, 0.9)], 0.8)
    scene = Scene("crossing", obstacles=(legs, post, trunk))
    painter = Painter(json.loads(json.dumps(about_run(scene, made().carry.carried, made().policy))))
    page, told = tmp_path / "live.html", tmp_path / "frames.json"
    page.write_text(live_page(painter.first(), "events"), encoding="utf-8")

    def frame(i, poses):
        around = SimpleNamespace(poses=poses, age_s=0.15)
        return painter.frame(moment(status_at(i), estimate_at(i), time_s=START_S + STEP_S * i, around=around))

    before, now = frame(20, None), poses_of([o.at(1.4) for o in scene.moving])
    seen = frame(30, now)
    assert ("Movers", "never", True) in before["facts"] and ("Movers", "150 ms", False) in seen["facts"]
    told.write_text(json.dumps([before]))
    hidden = shown(page, told)[1]
    told.write_text(json.dumps([before, seen]))
    there = shown(page, told)[1]
    count = len(seen["geom_pos"]) // 3
    assert len(there["solids"]) == len(hidden["solids"]) + 2
    assert apart(there["solids"], now[:, :3]) < 1e-3 and apart(hidden["solids"], now[:, :3]) > 0.1
    assert count and apart(there["solids"], [post.position_m]) < 1e-6
    # nothing of it in arrows before it is seen
    percept, task = estimate_at(30).percept, PolicyTask.from_meta(made().policy.meta, "student")
    pf = build_hod_pf(scene.still(), task.resolution_m, task.margin_m)
    with_her = read_fields(momentary_pf(pf, [o.at(1.4) for o in scene.moving]), percept, task)
    np.testing.assert_allclose(seen["arrow_force"], with_her.force_W.ravel(), atol=1e-4)


def test_a_replay_with_events(painter, tmp_path):
    first = painter.first()
    frames = np.arange(51)
    still = {
        name: np.repeat(getattr(first, name), len(frames), axis=0)
        for name in ("geom_pos_W", "geom_quat_W", "root_pos_W", "object_pos_W", "arrow_pos_W", "arrow_force_W")
    }
    events = (
        RolloutEvent(time_s=99.0, kind="mode", text="damping: start"),
        RolloutEvent(time_s=100.5, kind="mode", text="carry: carry"),
        RolloutEvent(time_s=101.0, kind="fault", text="box not seen"),
    )

    record = replace(first, **still, time_s=100.0 + 0.04 * frames, events=events)
    before, clicked = shown(write_html([record], tmp_path / "page.html"))
    assert before["story"] and before["badge"] == "running"
    assert before["events"] == ["-1.00 s  damping: start", "0.50 s  carry: carry", "1.00 s  box not seen"]
    assert before["marks"] == [["mode", 0.0], ["mode", 25.0], ["fault", 50.0]]
    assert (before["past"], before["clock"]) == (1, "0.00 / 2.00 s")
    assert (clicked["past"], clicked["clock"]) == (3, "1.00 / 2.00 s")
