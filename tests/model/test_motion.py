"""Motions of obstacles: right values, files, and what is refused."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from hotice.errors import InvalidScene
from hotice.model import Obstacle, Scene, load_scenes
from hotice.model.frames import quat_to_mat
from hotice.model.geometry.shapes import BoxShape, CapsuleShape, MeshShape
from hotice.model.moving.motion import Motion, WayPoint
from hotice.model.moving.person import walk, walking_person
from hotice.model.moving.still import only_still
from hotice.model.scene import MAX_MOVING, MomentaryScene
from hotice.model.scene_digest import scene_digest


def motion(*points, **more):
    """Of (time, x, y, yaw) each."""
    return Motion(
        way_points=tuple(WayPoint(time_s=t, position_m=(x, y, 0.0), yaw_rad=yaw) for t, x, y, yaw in points), **more
    )


def moving_box(course, position=(1.0, -0.5, 0.5), name="it"):
    return Obstacle(name, "side", BoxShape((0.2, 0.4, 1.0)), position, motion=course)


# ---- values ----------------------------------------------------------------------------------------------------------


def test_straight_and_at_constant_speed():
    course = motion((1.0, 1.0, -0.5, 0.0), (3.0, 1.0, 0.5, 1.0))
    p, yaw = course.at([0.0, 1.0, 1.5, 2.0, 3.0, 9.0])
    np.testing.assert_allclose(p[:, 1], [-0.5, -0.5, -0.25, 0.0, 0.5, 0.5])
    np.testing.assert_allclose(yaw, [0.0, 0.0, 0.25, 0.5, 1.0, 1.0])
    v, rate = course.rate_at([0.5, 2.0, 3.5])
    np.testing.assert_allclose(v[:, 1], [0.0, 0.5, 0.0])
    np.testing.assert_allclose(rate, [0.0, 0.5, 0.0])
    assert course.top_speed_m_s == pytest.approx(0.5) and course.top_rate_rad_s == pytest.approx(0.5)
    assert course.period_s == math.inf


def test_a_loop_goes_on():
    course = motion((0.5, 0.0, 0.0, 0.0), (1.5, 1.0, 0.0, 0.0), (2.5, 0.0, 0.0, 2 * math.pi), repeat="loop")
    assert course.period_s == 2.0
    times = np.linspace(0.5, 2.5, 21)
    for whole in (2.0, 200.0):
        np.testing.assert_allclose(course.at(times[:-1] + whole)[0], course.at(times[:-1])[0], atol=1e-9)
    np.testing.assert_allclose(course.at(0.1)[0], 0.0)


@pytest.mark.parametrize("repeat", ["once", "loop"])
def test_a_smooth_course_passes_its_points_without_a_jump_or_a_detour(repeat, rng):
    xy = rng.uniform(-1.0, 1.0, (6, 2))
    xy[-1] = xy[0]
    course = motion(*((2.0 * k, *p, 0.0) for k, p in enumerate(xy)), repeat=repeat, between="smooth")
    np.testing.assert_allclose(course.at(2.0 * np.arange(6))[0][:, :2], xy, atol=1e-12)
    t, h = np.linspace(0.01, 9.99, 500), 1e-6
    v = course.rate_at(t)[0]
    np.testing.assert_allclose(v, (course.at(t + h)[0] - course.at(t - h)[0]) / (2 * h), atol=1e-5)
    for k in range(1, 5):
        np.testing.assert_allclose(course.rate_at(2.0 * k - h)[0], course.rate_at(2.0 * k + h)[0], atol=1e-4)
    end = course.rate_at(10.0 - h)[0]
    np.testing.assert_allclose(end, course.rate_at(h)[0] if repeat == "loop" else 0.0, atol=1e-4)
    for k in range(5):
        part = course.at(np.linspace(2.0 * k, 2.0 * k + 2.0, 50))[0][:, :2]
        low, high = np.minimum(xy[k], xy[k + 1]), np.maximum(xy[k], xy[k + 1])
        assert (part > low - 1e-9).all() and (part < high + 1e-9).all()
    assert course.top_speed_m_s == pytest.approx(np.linalg.norm(v, axis=1).max(), rel=0.02)


def test_a_door_turns_about_its_hinge():
    hinge = (1.0, 0.4, 0.0)
    course = Motion(
        way_points=tuple(WayPoint(time_s=t, position_m=hinge, yaw_rad=t * 0.5 * math.pi) for t in (0.0, 1.0))
    )
    door = Obstacle("door", "side", BoxShape((0.04, 0.8, 1.5)), (1.0, 0.0, 0.75), motion=course)
    open_ = door.at(1.0)
    np.testing.assert_allclose(open_.position_m, (1.4, 0.4, 0.75), atol=1e-12)
    np.testing.assert_allclose(quat_to_mat(open_.quaternion_wxyz)[:, 1], (-1.0, 0.0, 0.0), atol=1e-12)
    assert open_.motion is None and door.at(0.0) == replace(door, motion=None)
    velocity, h = door.velocity_at(0.3), 1e-6
    expected = np.subtract(door.at(0.3 + h).position_m, door.at(0.3 - h).position_m) / (2 * h)
    np.testing.assert_allclose(velocity.v_W, expected, atol=1e-6)
    assert velocity.yaw_rate_rad_s == pytest.approx(0.5 * math.pi) and velocity.name == "door"


def test_a_person_walks_and_faces_where_it_goes():
    legs, trunk = walking_person("ann", [(1.0, -0.8), (1.0, 0.8), (0.0, 0.8)], 0.8, start_s=0.5)
    assert (legs.name, trunk.name) == ("ann_legs", "ann_trunk") and legs.motion is trunk.motion
    assert isinstance(legs.shape, CapsuleShape)
    heads = [o.position_m[2] + 0.5 * o.shape.length_m + o.shape.radius_m for o in (legs, trunk)]
    feet = [o.position_m[2] - 0.5 * o.shape.length_m - o.shape.radius_m for o in (legs, trunk)]
    assert max(heads) == pytest.approx(1.7) and min(feet) == pytest.approx(0.0) and heads[0] > feet[1]
    for t, xy in ((0.5, (1.0, -0.8)), (1.5, (1.0, 0.0)), (2.5, (1.0, 0.8)), (3.0, (0.6, 0.8)), (9.0, (0.0, 0.8))):
        np.testing.assert_allclose(trunk.at(t).position_m[:2], xy, atol=1e-12)
    assert [w.yaw_rad for w in legs.motion.way_points] == pytest.approx([0.5 * math.pi, math.pi, math.pi])
    np.testing.assert_allclose(trunk.velocity_at(1.0).v_W, (0.0, 0.8, 0.0), atol=0.3)
    round_ = walk([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 0.0)], 1.0, repeat="loop", between="smooth")
    assert round_.at(0.0)[0] == pytest.approx(round_.at(round_.period_s)[0])


@pytest.mark.parametrize(
    "places, speed, message",
    [
        ([(0, 0)], 1.0, "1 places: two or more are needed"),
        ([(0, 0), (0, 0)], 1.0, "places 0 and 1 are both"),
        ([(0, 0), (1, 0)], 0.0, "speed_m_s is 0.0: a finite number above 0"),
        ([(0, 0), (1, 0)], 5.1, "at most 5 m/s"),
    ],
)
def test_what_no_person_does(places, speed, message):
    with pytest.raises(InvalidScene, match=message):
        walking_person("ann", places, speed)


# ---- scenes ----------------------------------------------------------------------------------------------------------


def test_a_scene_at_a_moment():
    course = motion((0.0, 1.0, -0.5, 0.0), (2.0, 1.0, 0.5, 0.0))
    wall = Obstacle("wall", "side", BoxShape((0.1, 0.1, 1.0)), (1.5, 0.9, 0.5))
    scene = Scene("s", obstacles=(wall, moving_box(course)))
    then = scene.at(1.5)
    assert isinstance(then, MomentaryScene) and not then.moving and scene.moving == scene.obstacles[1:]
    assert then.obstacles[0] == wall and then.obstacles[1].position_m == pytest.approx((1.0, 0.25, 0.5))
    (velocity,) = then.velocities
    assert velocity.name == "it" and velocity.v_W == pytest.approx((0.0, 0.5, 0.0))
    assert scene.at(0.0).obstacles[1] == replace(scene.obstacles[1], motion=None)
    assert scene.still().obstacles == (wall,)
    quiet = Scene("q", obstacles=(wall,))
    assert quiet.still() is quiet and only_still(quiet, "who") is quiet and not quiet.at(3.0).velocities
    with pytest.raises(InvalidScene, match="obstacle 'it' moves, which the walk does not know"):
        only_still(scene, "the walk")
    with pytest.raises(InvalidScene, match="time_s is nan"):
        scene.at(math.nan)


def test_files_keep_motions_and_others_stay_as_they_are(tmp_path):
    course = motion((0.0, 1.0, -0.5, 0.0), (2.0, 1.0, 0.5, 0.3), (4.0, 1.0, -0.5, 0.0), repeat="loop", between="smooth")
    scene = Scene("s", obstacles=(moving_box(course),))
    scene.save(tmp_path / "s.json")
    assert Scene.load(tmp_path / "s.json") == scene and scene.obstacles[0].motion == course
    entry = json.loads((tmp_path / "s.json").read_text())["obstacles"][0]["motion"]
    assert entry["way_points"][1] == {"time_s": 2.0, "position_m": [1.0, 0.5, 0.0], "yaw_rad": 0.3}
    assert scene_digest(scene) != scene_digest(scene.still()) != scene_digest(scene.at(0.0))
    for old in load_scenes(["bench20"]):
        assert "motion" not in json.dumps(old.to_dict())


def test_digests_of_scenes_without_motion_are_those_of_before():
    digests = {scene.name: scene_digest(scene)[:16] for scene in load_scenes(["beam", "gap", "bench20/20_random"])}
    assert digests == DIGESTS


DIGESTS = {"beam": "ef571e387c9cb7dd", "gap": "17cd695d86fcebe1", "bench20/20_random": "523807aaea72492c"}


def test_what_moves_may_pass_over_the_goal_but_not_begin_at_the_start():
    over_goal = motion((0.0, 2.0, 0.0, 0.0), (2.0, 2.0, 0.9, 0.0))
    Scene("s", obstacles=(moving_box(over_goal, (2.0, 0.0, 0.5)),))
    over_start = motion((0.0, 0.0, 0.0, 0.0), (2.0, 0.0, 0.9, 0.0))
    with pytest.raises(InvalidScene, match="start .* is inside obstacle 'it'"):
        Scene("s", obstacles=(moving_box(over_start, (0.0, 0.0, 0.5)),))
    leaves = motion((0.0, 1.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))
    Scene("s", obstacles=(moving_box(leaves, (1.0, 0.0, 0.5)),))


# ---- refusals --------------------------------------------------------------------------------------------------------

POINTS = [{"time_s": 0.0, "position_m": [1, 0, 0]}, {"time_s": 2.0, "position_m": [1, 1, 0]}]


@pytest.mark.parametrize(
    "entry, message",
    [
        (None, "motion is None: a mapping with way_points"),
        ({}, "motion lacks 'way_points'"),
        ({"way_points": POINTS, "speed": 1}, "motion has unknown key 'speed': known are way_points, repeat, between"),
        ({"way_points": 3}, "way_points is 3: a list is needed"),
        ({"way_points": POINTS[:1]}, "1 way_points: 2 to 1,000 are needed"),
        ({"way_points": POINTS * 501}, "1,002 way_points: at most 1,000 are allowed"),
        ({"way_points": POINTS[::-1]}, r"way_points\[1\] time_s is 0 after 2: times must grow by at least 0.001 s"),
        ({"way_points": [POINTS[0], POINTS[0]]}, "times must grow"),
        ({"way_points": POINTS, "repeat": "twice"}, "repeat is 'twice': known are once, loop"),
        ({"way_points": POINTS, "repeat": "loop"}, "a loop must end where it begins; add a way point"),
        ({"way_points": POINTS, "between": "spline"}, "between is 'spline': known are linear, smooth"),
        ({"way_points": [POINTS[0], [2, 1, 0]]}, r"way_points\[1\] is \[2, 1, 0\]: a mapping with time_s"),
        ({"way_points": [POINTS[0], {"time_s": 1}]}, r"way_points\[1\] lacks 'position_m'"),
        (
            {"way_points": [POINTS[0], POINTS[1] | {"time_s": -1}]},
            r"way_points\[1\] time_s is -1: a finite number from 0",
        ),
        ({"way_points": [POINTS[0], POINTS[1] | {"time_s": math.nan}]}, "time_s is nan"),
        ({"way_points": [POINTS[0], POINTS[1] | {"position_m": [1, 1]}]}, "a list of 3 numbers is needed"),
        ({"way_points": [POINTS[0], POINTS[1] | {"position_m": [1, 1e9, 0]}]}, "within ±10000"),
        ({"way_points": [POINTS[0], POINTS[1] | {"position_m": [1, 11, 0]}]}, "passed at up to 5.5 m/s: at most 5 m/s"),
        ({"way_points": [POINTS[0], POINTS[1] | {"yaw_rad": 15}]}, "passed at up to 7.5 rad/s: at most 6.28 rad/s"),
        (
            {"way_points": [POINTS[0], POINTS[1], POINTS[0] | {"time_s": 4, "yaw_rad": 1}], "repeat": "loop"},
            "end as it",
        ),
        ({"way_points": [POINTS[0], POINTS[1] | {"position_m": [1, 8, 0]}], "between": "smooth"}, "up to 6 m/s"),
    ],
)
def test_motions_that_are_none(entry, message):
    data = Scene("s", obstacles=(Obstacle("it", "side", BoxShape((0.1, 0.1, 1.0)), (1.0, 0.0, 0.5)),)).to_dict()
    data["obstacles"][0]["motion"] = entry
    with pytest.raises(InvalidScene, match=message) as caught:
        Scene.from_dict(data)
    assert "obstacle 'it'" in str(caught.value) and "motion" in str(caught.value) and "\n" not in str(caught.value)


def test_meshes_and_crowds_do_not_move(tmp_path):
    course = motion((0.0, 1.0, 0.0, 0.0), (2.0, 1.0, 0.5, 0.0))
    (tmp_path / "t.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n")
    with pytest.raises(InvalidScene, match="is a mesh: only box, cylinder, capsule and sphere may have a motion"):
        Obstacle("it", "side", MeshShape("t.obj", 0.1, tmp_path), (1.0, 0.5, 0.0), motion=course)
    with pytest.raises(InvalidScene, match="has motion 'fast'"):
        moving_box("fast")
    crowd = tuple(moving_box(course, name=f"{i}") for i in range(MAX_MOVING + 1))
    Scene("s", obstacles=crowd[1:])
    with pytest.raises(InvalidScene, match="33 obstacles have a motion: at most 32"):
        Scene("s", obstacles=crowd)
