import mujoco
import numpy as np
import pytest

from hotice.model import Scene
from hotice.replay import RolloutRecord
from hotice.replay.touch import FAR_M, find_touches

WORLD = """
<mujoco>
  <worldbody>
    <geom name="floor" type="plane" size="0 0 1"/>
    {obstacles}
    <body name="pelvis" pos="0 0 1">
      <freejoint/>
      <geom name="trunk" type="sphere" size="0.1"/>
    </body>
    <body name="object" pos="0 5 1">
      <freejoint/>
      <geom name="object" type="sphere" size="0.2"/>
    </body>
  </worldbody>
</mujoco>
"""
POST = '<geom name="obstacle/post#1" type="box" size="0.1 0.5 2" pos="1 0 0"/>'


def world(obstacles=POST):
    return mujoco.MjModel.from_xml_string(WORLD.format(obstacles=obstacles))


def ahead(model, *xs):
    """States in which the trunk is at each x, and the object at y = 5."""
    qpos = np.tile(model.qpos0, (len(xs), 1))
    qpos[:, 0] = xs
    return qpos


def test_the_first_touch_of_each_pair_is_told_and_clearance_measured():
    model = world()
    qpos = ahead(model, -5.0, 0.5, 0.81, 0.5, 0.82)
    qpos[-1, 7:9] = 1.0, 0.6
    found = find_touches(model, qpos, 0.1 * np.arange(5))
    assert [(event.time_s, event.text) for event in found.events] == [
        (pytest.approx(0.2), "trunk touches post#1"),
        (pytest.approx(0.4), "object touches post#1"),
    ]
    assert found.events[0].kind == "touch" and found.events[0].solids == ("trunk", "post#1")
    assert found.clearance_m[0] == FAR_M
    np.testing.assert_allclose(found.clearance_m[1:4], [0.3, -0.01, 0.3], atol=1e-6)


def test_without_obstacles_nothing_is_known():
    found = find_touches(world(""), ahead(world(""), 0.0), np.zeros(1))
    assert found.events == [] and found.clearance_m.shape == (0,)


def test_records_have_them_and_keep_them(tmp_path):
    model, box = world(), {"outcome": "robot_collision", "policy": "none", "scene": Scene("post")}
    from hotice.model import Sphere

    record = RolloutRecord.from_states(
        model, ahead(model, 0.5, 0.81), carried=Sphere(0.2, 1.0), time_s=[0.0, 0.02], **box
    )
    assert [event.kind for event in record.events] == ["touch"] and len(record.clearance_m) == 2
    loaded = RolloutRecord.load(record.save(tmp_path / "r.npz"))
    assert loaded.events == record.events
    np.testing.assert_allclose(loaded.clearance_m, record.clearance_m, atol=1e-6)
    assert loaded.every(1.0).clearance_m.shape == (2,)
