"""Obstacles that move, in records, on pages and in pictures."""

import json
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from matplotlib.figure import Figure

from hotice.model import Obstacle, Scene, Sphere
from hotice.model.geometry.shapes import SphereShape
from hotice.model.moving import Motion, WayPoint, walking_person
from hotice.replay import RolloutEvent, RolloutRecord, write_html
from hotice.replay.picture import draw_frame
from hotice.replay.touch import find_touches

HARNESS = Path(__file__).parent / "viewer_in_node.js"
BALL = """
<mujoco>
  <worldbody>
    <body name="obstacle/ball" mocap="true" pos="1 0 1"><geom name="obstacle/ball" type="sphere" size="0.2"/></body>
    <body name="pelvis" pos="0 0 1"><freejoint/><geom name="trunk" type="sphere" size="0.1"/></body>
    <body name="object" pos="0 5 1"><freejoint/><geom name="object" type="sphere" size="0.2"/></body>
  </worldbody>
</mujoco>
"""


@pytest.fixture(scope="module")
def crossing(record):
    """The record's walk, and a post that stands, past a person who crosses; with three events."""
    post = Obstacle("post", "side", SphereShape(0.1), (2.0, 0.8, 0.1))
    people = walking_person("ann", [(1.0, -0.9), (1.0, 0.9)], 0.9)
    events = tuple(RolloutEvent(time_s=t, kind="fault", text=f"at {t}") for t in (0.0, 0.5, 1.0))
    return replace(record, scene=Scene("walks", obstacles=(people[0], post, people[1])), events=events)


@pytest.mark.skipif(shutil.which("node") is None, reason="needs node")
def test_a_page_shows_it_where_it_is(crossing, tmp_path):
    page = write_html([crossing], tmp_path / "page.html")
    done = subprocess.run(["node", HARNESS, page], capture_output=True, text=True, check=True)
    for seen, time_s in zip(json.loads(done.stdout), (0.0, 1.0), strict=True):
        shown = np.array(seen["solids"])
        for obstacle in crossing.scene.at(time_s).obstacles:
            assert np.linalg.norm(shown - obstacle.position_m, axis=1).min() < 1e-3, (time_s, obstacle.name)


def test_pages_of_what_stands_still_hold_nothing_of_it(record, crossing, tmp_path):
    still, moving = (write_html([r], tmp_path / f"{i}.html").read_text() for i, r in enumerate((record, crossing)))
    assert '"moving_pos":' not in still and '"moving":[0,2]' in moving


def test_records_of_models_show_what_moves_once():
    model = mujoco.MjModel.from_xml_string(BALL)
    box, asked = Sphere(0.2, 1.0), {"outcome": "success", "policy": "none", "time_s": [0.0]}
    assert RolloutRecord.from_states(model, model.qpos0, scene=Scene("s"), carried=box, **asked).geom_names == [
        "trunk",
        "object",
    ]


def test_a_record_keeps_motions(crossing, tmp_path):
    assert RolloutRecord.load(crossing.save(tmp_path / "r.npz")).scene == crossing.scene


def test_touches_are_those_of_where_it_is_then():
    model = mujoco.MjModel.from_xml_string(BALL)
    course = Motion(way_points=tuple(WayPoint(time_s=t, position_m=(x, 0.0, 1.0)) for t, x in ((0.0, 1.0), (1.0, 0.0))))
    scene = Scene("s", obstacles=(Obstacle("ball", "side", SphereShape(0.2), (1.0, 0.0, 1.0), motion=course),))
    qpos = np.tile(model.qpos0, (5, 1))
    found = find_touches(model, qpos, np.linspace(0.0, 1.0, 5), scene)
    np.testing.assert_allclose(found.clearance_m, [0.7, 0.45, 0.2, -0.05, -0.3], atol=1e-6)
    (event,) = found.events
    assert event.time_s == 0.75 and event.text == "ball walks into trunk: the robot stands"
    # a robot that has come 0.1 m in the last half second does not stand
    qpos[:, 0] = np.linspace(-0.2, 0.0, 5)
    (event,) = find_touches(model, qpos, np.linspace(0.0, 1.0, 5), scene).events
    assert event.text == "trunk touches ball"


def test_pictures_show_it_where_it_is(crossing):
    seen = []
    for frame in (0, 100):
        axes = Figure().subplots()
        draw_frame(axes, crossing, frame, 0.5, 0.4, False)
        seen.append(np.concatenate([p.vertices.mean(axis=0) for c in axes.collections for p in c.get_paths()]))
    still = replace(crossing, scene=crossing.scene.at(0.0))
    axes = Figure().subplots()
    draw_frame(axes, still, 100, 0.5, 0.4, False)
    as_at_first = np.concatenate([p.vertices.mean(axis=0) for c in axes.collections for p in c.get_paths()])
    assert len(seen[1]) != len(as_at_first) or not np.allclose(seen[1], as_at_first)
