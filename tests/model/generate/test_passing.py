"""The search over places and times: what it finds holds, and what it does not find is closed."""

import numpy as np
import pytest

from hotice.errors import InvalidConfig
from hotice.model import Obstacle, Scene
from hotice.model.generate.passing import BODY_RADIUS_M, UNTIL_S, WALK_M_S, check_passing
from hotice.model.geometry.shapes import BoxShape, CylinderShape
from hotice.model.moving.motion import Motion, WayPoint
from hotice.model.moving.person import walking_person

WIDE = ((-0.5, -1.5, 0.0), (2.5, 1.5, 1.5))


def moved(name, shape, *points):
    course = Motion(way_points=tuple(WayPoint(time_s=t, position_m=(x, y, 0.0)) for t, x, y in points))
    return Obstacle(name, "side", shape, (*points[0][1:], 0.75), motion=course)


def holds(scene, found):
    """A way that was found: it begins and ends right, is no faster than a walk, and touches nothing, also between."""
    path, radius = found.path, BODY_RADIUS_M
    np.testing.assert_allclose(path[0], [*scene.start[:2], 0.0])
    assert found.ok and np.linalg.norm(path[-1, :2] - scene.goal) <= 0.1 and found.arrival_s <= UNTIL_S + 0.05
    speed = np.linalg.norm(np.diff(path[:, :2], axis=0), axis=1) / np.diff(path[:, 2])
    assert speed.max() <= WALK_M_S + 1e-9
    turns = np.linspace(0.0, 2.0 * np.pi, 40, endpoint=False)
    ring = radius * np.column_stack([np.cos(turns), np.sin(turns)])
    for time_s in np.arange(0.0, found.arrival_s, 0.02):
        xy = [np.interp(time_s, path[:, 2], path[:, i]) for i in range(2)]
        points = np.concatenate([np.column_stack([xy + ring, np.full(40, z)]) for z in (0.2, 0.7, 1.2)])
        assert scene.at(time_s).signed_distance(points).min() > 0.0, time_s
    return found


def test_nothing_in_the_way():
    found = holds(Scene("s", WIDE), check_passing(Scene("s", WIDE)))
    assert found.arrival_s == pytest.approx(1.9 / 0.8, abs=0.11) and found.waiting_s == 0.0


def test_it_waits_for_a_door_and_slips_through_one_that_closes():
    leaf = BoxShape((0.1, 3.0, 1.5))
    late = Scene("late", WIDE, obstacles=(moved("door", leaf, (2.0, 1.0, 0.0), (3.0, 1.0, 2.6)),))
    found = holds(late, check_passing(late))
    assert found.arrival_s > 3.5 and found.waiting_s > 0.5
    closing = Scene("closing", WIDE, obstacles=(moved("door", leaf, (1.8, 1.0, 2.6), (2.8, 1.0, 0.0)),))
    assert holds(closing, check_passing(closing)).waiting_s == 0.0
    slow = check_passing(closing, speed_m_s=0.4)
    assert not slow.ok and slow.reason.startswith("no way in time") and "before the goal" in slow.reason
    shut = Scene("shut", WIDE, obstacles=(Obstacle("wall", "side", leaf, (1.0, 0.0, 0.75)),))
    found = check_passing(shut)
    assert not found.ok and found.path[-1, 0] < 0.6


def test_people_are_let_pass():
    for speed in (0.3, 0.8, 1.2):
        scene = Scene("s", WIDE, obstacles=walking_person("ann", [(1.1, -1.2), (1.1, 1.5)], speed, start_s=0.4))
        assert holds(scene, check_passing(scene)).clearance_m >= 0.03 - 1e-9


def test_a_start_that_is_too_near_and_numbers_that_are_none():
    near = Scene("s", WIDE, obstacles=(Obstacle("post", "side", CylinderShape(0.1, 1.5), (0.3, 0.0, 0.75)),))
    assert "too near to the start" in check_passing(near).reason
    with pytest.raises(InvalidConfig, match="speed_m_s is 0"):
        check_passing(near, speed_m_s=0.0)
