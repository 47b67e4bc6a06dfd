"""A walk that is meddled with: what is ordered happens, fields follow obstacles, and the robot finds another way."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest

from hotice.errors import FieldsNotBuilt, HoticeError
from hotice.fields import build_hod_pf
from hotice.fields.live import LiveField
from hotice.model import Box, Obstacle, Scene
from hotice.model.geometry.shapes import BoxShape
from hotice.model.moving import walking_person
from hotice.model.moving.motion import Motion, WayPoint
from hotice.model.scene import MomentaryScene
from hotice.policy import open_policy
from hotice.view import orders
from hotice.view.frames import Painter
from hotice.view.obstacles import OBSTACLE_M_S, Obstacles
from hotice.view.session import MOST_WAITING, Choice, Session

ASIDE = (1.0, -0.75, 0.5)
POST = Obstacle("post", "side", BoxShape((0.2, 0.3, 1.0)), ASIDE)
SCENE = Scene("post", obstacles=(POST,))


@pytest.fixture(scope="module")
def live():
    with LiveField(SCENE) as field:
        yield field


@pytest.fixture
def session(live):
    live.move({"post": (ASIDE, POST.quaternion_wxyz)})
    live.wait()
    names = ("student", "carry")
    policies = {name: lambda name=name: open_policy(name) for name in names}
    return Session(
        SCENE, live, Choice(policies=policies, policy="student", carried=Box((0.3, 0.3, 0.25), 1.5), noise=False)
    )


def walk(session, seconds, until=lambda: False):
    for _ in range(round(seconds / 0.02)):
        session.tick()
        if until():
            return True
    return until()


def move(session, to_W):
    session.order(orders.Move(obstacle="post", to_W=to_W))


def test_the_robot_arrives_and_stays(session):
    assert walk(session, 8.0, lambda: session.walk.standing == "at the goal") and not session.walk.over
    assert walk(session, 1.0, lambda: bool(session.walk.over)) is False
    assert float(session.walk.reading.goal_distance[0]) < 0.3 and len(session.walk.touches) == 0
    assert [event["text"] for event in session.walk.events] == ["at the goal"]


def test_an_obstacle_goes_where_it_is_ordered_and_fields_follow(session, live):
    move(session, (1.0, -0.3, 0.5))
    session.tick()
    gone = np.linalg.norm(np.subtract(session.obstacles[0].position_m, ASIDE))
    assert gone == pytest.approx(OBSTACLE_M_S * 0.02)
    np.testing.assert_allclose(session.walk.world.data.mocap_pos[0], session.obstacles[0].position_m)
    for _ in range(20):
        session.tick()
    assert session.obstacles[0].position_m == (1.0, -0.3, 0.5)
    live.wait()
    moved = replace(POST, position_m=(1.0, -0.3, 0.5))
    fresh = build_hod_pf(MomentaryScene("post", obstacles=(moved,)))
    points = np.random.default_rng(0).uniform((-0.4, -0.9, 0.1), (2.4, 0.9, 1.4), (200, 3))
    np.testing.assert_array_equal(live.fields.sgf.sample(points), fresh.sgf.sample(points))
    np.testing.assert_array_equal(live.fields.ogf.sample(points), fresh.ogf.sample(points))
    session.order(orders.Restore())
    for _ in range(20):
        session.tick()
    assert session.obstacles == (POST,)


def test_another_way_is_found_round_an_obstacle_that_comes(session, live):
    assert walk(session, 8.0, lambda: session.walk.qpos[0] > 0.3)
    before = Painter(session).frame()["ways"]
    move(session, (1.2, -0.15, 0.5))
    walk(session, 0.3)
    live.wait()
    after = Painter(session).frame()["ways"]
    # to the left of the post, whose left side is at y = 0
    assert max(after[1]["points"][1::3]) > 0.1 > max(before[1]["points"][1::3])
    left = []
    assert walk(session, 12.0, lambda: left.append(session.walk.qpos[1]) or session.walk.standing == "at the goal")
    assert max(left) > 0.15 and not session.walk.over and len(session.walk.touches) == 0


def test_it_stands_where_there_is_no_way_and_goes_on(session, live):
    wall = Obstacle("wall", "side", BoxShape((0.1, 3.0, 3.0)), (1.2, 0.0, 0.75))
    live.show([POST, wall])
    live.wait()
    walk(session, 0.4)
    assert session.walk.standing == "no way" and session.walk.reading.goal_distance[0] > 1.0
    here = session.walk.qpos[:2].copy()
    walk(session, 2.0)
    assert not session.walk.over and np.linalg.norm(session.walk.qpos[:2] - here) < 0.25
    live.show([POST])
    live.wait()
    walk(session, 0.2)
    assert session.walk.standing == "" and [event["text"] for event in session.walk.events] == ["no way", "walks on"]


def test_touches_are_told_by_name(session):
    move(session, (0.1, -0.2, 0.5))
    walk(session, 1.5, lambda: len(session.walk.touches) > 0)
    told = [event for event in session.walk.events if event["kind"] == "touch"]
    assert told and all(event["text"].endswith("touches post") for event in told)


def test_who_stands_is_walked_into(session, live):
    """By an obstacle that comes before the robot has gone 0.1 m; one that stands there is touched."""
    walk, at = session.walk, replace(POST, position_m=(0.1, -0.42, 0.5))
    walk.world.put([at])
    for _ in range(5):
        at = replace(at, position_m=(0.1, at.position_m[1] + 0.03, 0.5))
        walk.step([at] if not walk.touches else [])
    told = [event["text"] for event in walk.events if event["kind"] == "touch"]
    assert told and all(re.fullmatch(r"post walks into \w+: the robot stands", text) for text in told)
    walk.world.put([replace(POST, position_m=(0.0, -0.2, 0.5))])
    walk.step()
    assert len(walk.events) > len(told)
    assert str(walk.events[-1]["text"]).endswith("touches post")


def test_a_push_is_felt_and_needs_time_that_goes_on(session):
    walk(session, 0.1)
    session.order(orders.Push(velocity_W=(0.0, 1.5)))
    session.tick()
    assert session.walk.world.data.qvel[1] > 0.8
    session.order(orders.Pause(on=True))
    session.order(orders.Push(velocity_W=(0.0, 1.0)))
    before = session.walk.time_s
    session.tick()
    assert session.walk.time_s == before and "time stands still" in str(session.walk.events[-1]["text"])


def test_a_fall_ends_the_walk_and_a_restart_begins_another(session):
    walk(session, 0.2)
    for _ in range(4):
        session.order(orders.Push(velocity_W=(0.0, 1.5)))
    assert walk(session, 4.0, lambda: session.walk.over != "")
    assert session.walk.over in ("fall", "drop")
    walk(session, 3.0)
    assert session.walk.time_s < 8.0
    frame = Painter(session).frame()
    assert (frame["mode"], frame["tone"]) == (session.walk.over, "failure")
    session.order(orders.Restart())
    session.tick()
    assert session.walk.over == "" and session.walk.time_s == pytest.approx(0.02) and session.walk.events == []


def test_objects_policies_and_noise_are_changed(session):
    walk(session, 0.1)
    session.order(orders.Take(carried=Box((0.25, 0.35, 0.2), 2.0)))
    session.tick()
    assert session.choice.carried.mass_kg == 2.0 and session.walk.time_s == pytest.approx(0.02)
    assert session.walk.world.model.body("object").mass[0] == pytest.approx(2.0)
    session.order(orders.Noise(on=True))
    session.tick()
    assert session.choice.noise and session.walk.time_s == pytest.approx(0.02)
    session.order(orders.UsePolicy(policy="carry"))
    session.tick()
    assert session.choice.policy == "carry"
    painter = Painter(session)
    assert painter.frame()["chosen"]["policy"] == "carry"


def test_what_cannot_be_is_told_and_all_stays(session):
    """A box that is too heavy for the arms."""
    walk(session, 0.1)
    session.order(orders.Take(carried=Box((0.6, 0.6, 0.6), 6.0)))
    session.tick()
    assert session.choice.carried.mass_kg == 1.5 and session.walk.time_s > 0.1
    assert session.walk.events[-1]["kind"] == "fault" and "too heavy" in str(session.walk.events[-1]["text"])


def test_a_policy_of_other_fields_is_refused(session):
    class Other:
        name, layout = "other", []
        meta = {**open_policy("student").meta}
        run = staticmethod(lambda observation: observation)

    Other.meta["task"] = {**Other.meta["task"], "margin_m": 0.2}
    session.order(Other())
    session.tick()
    assert "reads fields of 0.04 m with a margin of 0.2 m" in str(session.walk.events[-1]["text"])


def test_orders_are_bounded(session):
    for _ in range(MOST_WAITING):
        session.order(orders.Restart())
    with pytest.raises(HoticeError, match="wait already"):
        session.order(orders.Restart())


def test_a_frame_is_json_and_says_what_is_behind(session, live):
    painter = Painter(session)
    session.order(orders.Slice(field="ogf", height_m=0.5))
    walk(session, 0.1)
    frame = json.loads(json.dumps(painter.frame(), allow_nan=False))
    assert frame["mode"] == "walking" and frame["behind"] == 0.0
    assert [way["field"] for way in frame["ways"]] == ["sgf", "sgf", "ogf"]
    # both robot's ways end at the goal
    np.testing.assert_allclose(frame["ways"][1]["points"][-3:-1], [2.0, 0.0], atol=0.1)
    cut = frame["slice"]
    assert cut["field"] == "ogf" and len(cut["angles"]) == 30 * 20 and cut["columns"] == 30
    # inside the post there is no direction; far from it all lead ahead
    x, y = round((1.0 - cut["first"][0]) / cut["spacing"]), round((-0.75 - cut["first"][1]) / cut["spacing"])
    assert cut["angles"][30 * y + x] == 999 and abs(cut["angles"][30 * 12 + 8]) < 30
    move(session, (1.0, 0.0, 0.5))
    live_before = live.newest.version
    session.tick()
    facts = dict((name, (text, bad)) for name, text, bad in painter.frame()["facts"])
    assert facts["Touches"] == ("0", False) and facts["Fields"][0] == "as the obstacles are"
    assert live.wait().version > live_before
    place = frame["obstacles"][0]
    np.testing.assert_allclose(place, [*ASIDE, 1, 0, 0, 0])


def test_noise_is_that_of_students_and_drawn_anew(session):
    """Of the same seed the same walk; the next walk has other noise."""
    session.order(orders.Noise(on=True))
    session.tick()
    first = session.walk.percept.vector.copy()
    session.order(orders.Restart())
    session.tick()
    assert not np.array_equal(first, session.walk.percept.vector)
    true = session.walk._senses._true(*session.walk.world.state())
    assert 1e-4 < np.abs(session.walk.percept.q - true.q).max() < 0.2


def test_obstacles_with_a_motion_follow_it_unless_a_hand_holds_them():
    ends = (
        WayPoint(time_s=0.5, position_m=(1.0, -0.5, 0.0)),
        WayPoint(time_s=1.5, position_m=(1.0, 0.5, 0.0), yaw_rad=1.0),
    )
    motion = Motion(way_points=ends)
    cart = Obstacle("cart", "side", BoxShape((0.2, 0.2, 1.0)), (1.2, -0.5, 0.5), motion=motion)
    scene = Scene("cart", obstacles=(cart, POST))
    obstacles, times = Obstacles(scene), 0.02 * np.arange(1, 60)
    for t in times:
        assert len(obstacles.advance(t, 0.02)) == (0.5 < t < 1.53)
        assert obstacles.now["cart"] == cart.at(t) and obstacles.now["post"] == POST
    obstacles.bring("cart", (0.9, 0.2, 0.5))
    for t in times + 1.2:
        obstacles.advance(t, 0.02)
    assert obstacles.now["cart"].position_m == (0.9, 0.2, 0.5)
    assert obstacles.restart() == () and obstacles.now["cart"].position_m == (0.9, 0.2, 0.5)
    obstacles.let_go()
    for _ in range(10):
        obstacles.advance(1.0, 0.02)
    assert obstacles.now["cart"] == cart.at(1.0)
    assert obstacles.restart() == (cart.at(0.0),)


def test_parts_that_share_a_motion_are_dragged_together():
    person = walking_person("ann", [(1.0, -1.0), (1.0, 1.0)], 0.5)
    obstacles = Obstacles(Scene("crossing", obstacles=(*person, POST)))
    for t in 0.02 * np.arange(21):
        obstacles.advance(t, 0.02)
    x, y, z = obstacles.now["ann_legs"].position_m
    obstacles.bring("ann_legs", (x + 0.1, y - 0.2, z))
    for _ in range(20):
        obstacles.advance(0.4, 0.02)
    for each in person:
        np.testing.assert_allclose(
            np.subtract(obstacles.now[each.name].position_m, each.at(0.4).position_m), [0.1, -0.2, 0]
        )
    assert obstacles.now["post"] == POST


@pytest.fixture
def busy():
    """A cart that crosses behind the goal at 0.5 m/s, and the post."""
    ways = tuple(WayPoint(time_s=t, position_m=(2.3, y, 0.0)) for t, y in ((0.0, -0.8), (2.0, 0.2)))
    cart = Obstacle("cart", "side", BoxShape((0.1, 0.2, 1.0)), (2.3, -0.8, 0.5), motion=Motion(way_points=ways))
    scene = Scene("busy", obstacles=(cart, POST))
    with LiveField(scene.at(0.0)) as field:
        policies = {"student": lambda: open_policy("student")}
        choice = Choice(policies=policies, policy="student", carried=Box((0.3, 0.3, 0.25), 1.5), noise=False)
        yield Session(scene, field, choice)


def test_what_moves_goes_on_while_others_are_dragged_and_begins_anew_with_the_walk(busy):
    cart = busy.scene.obstacles[0]
    walk(busy, 0.5)
    # where it is at the end of the step that the robot has lived
    assert busy.walk.time_s == pytest.approx(0.5)
    np.testing.assert_allclose(busy.obstacles[0].position_m, cart.at(0.5).position_m, atol=1e-9)
    np.testing.assert_allclose(busy.walk.world.data.mocap_pos[0], busy.obstacles[0].position_m, atol=1e-9)
    move(busy, (1.0, -0.6, 0.5))
    walk(busy, 0.3)
    np.testing.assert_allclose(busy.obstacles[0].position_m, cart.at(0.8).position_m, atol=1e-9)
    assert busy.obstacles[1].position_m == (1.0, -0.6, 0.5)
    built = busy.live.wait()
    fresh = build_hod_pf(MomentaryScene("busy", obstacles=busy.obstacles))
    points = np.random.default_rng(0).uniform((-0.4, -0.9, 0.1), (2.4, 0.9, 1.4), (200, 3))
    np.testing.assert_array_equal(built.fields.sgf.sample(points), fresh.sgf.sample(points))
    busy.order(orders.Pause(on=True))
    walk(busy, 0.2)
    np.testing.assert_allclose(busy.obstacles[0].position_m, cart.at(0.8).position_m, atol=1e-9)
    busy.order(orders.Restart())
    busy.tick()
    assert busy.walk.time_s == 0.0 and busy.obstacles == (cart.at(0.0), replace(POST, position_m=(1.0, -0.6, 0.5)))
    np.testing.assert_allclose(busy.walk.world.data.mocap_pos, [o.position_m for o in busy.obstacles])


def test_the_page_takes_places_from_frames_alone(busy):
    """A record of motions would put what moves back to its first place whenever the page is drawn between frames."""
    walk(busy, 0.1)
    first = Painter(busy).first()
    assert first.scene.moving == () and first.scene.obstacles == busy.scene.at(0.0).obstacles


def test_a_lost_worker_ends_it_when_an_obstacle_moves():
    """Fields that never follow would be worse than none."""
    with LiveField(SCENE) as live:
        policies = {"student": lambda: open_policy("student")}
        session = Session(SCENE, live, Choice(policies=policies, policy="student", carried=Box((0.3, 0.3, 0.25), 1.5)))
        live.close()
        session.tick()
        move(session, (1.0, -0.3, 0.5))
        with pytest.raises(FieldsNotBuilt, match="has ended"):
            session.tick()
