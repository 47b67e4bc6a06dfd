"""Obstacles that move about a robot: samples of their poses, where they are taken to be, and fields with them."""

import math
import struct
import zlib
from dataclasses import replace

import numpy as np
import pytest

from hotice.deploy.clock import SimulatedClock
from hotice.deploy.estimate.movers import MoverTracker
from hotice.deploy.guard.modes import Mode
from hotice.deploy.messages.invalid import InvalidMessage
from hotice.deploy.runner.around import Around
from hotice.deploy.runner.ways import LiveWays, ToldWays
from hotice.deploy.sources import MemorySource, MoverSample
from hotice.deploy.sources.records import scene_mark
from hotice.fields import build_hod_pf
from hotice.fields.moving.momentary import momentary_pf, moved, poses_of
from hotice.model import BoxShape, Obstacle, Scene
from hotice.model.frames import quat_from_axis_angle, quat_from_yaw, quat_mul, quat_rotate
from hotice.model.geometry.shapes import SphereShape
from hotice.model.moving import Motion, WayPoint, walking_person
from hotice.model.moving.sight import seen_moving
from hotice.model.scene import MomentaryScene
from hotice.model.source import MapSource
from hotice.policy import PerceptModel, open_policy, read_fields
from hotice.policy.carry_policy import CarryPolicy
from hotice.task.moving import MovingConfig
from tests.deploy.simulated_fixture import STEP_S, Lab
from tests.deploy.simulated_fixture import carry as solved
from tests.deploy.test_runner import BOX, Desk, a_robot

DOOR = Motion(
    way_points=(
        WayPoint(time_s=0.2, position_m=(1.6, 0.8, 0.0), yaw_rad=0.0),
        WayPoint(time_s=1.2, position_m=(1.6, 0.8, 0.0), yaw_rad=1.5),
    ),
    between="smooth",
)
MOVING = (
    *walking_person("ann", [(1.2, -0.9), (1.2, 0.9)], 0.8),
    Obstacle("door", "side", BoxShape((0.6, 0.05, 1.4)), (1.9, 0.8, 0.7), motion=DOOR),
)
POST = Obstacle("post", "side", BoxShape((0.2, 0.2, 1.0)), (0.8, 0.7, 0.5))
SCENE = Scene("crossing", obstacles=(MOVING[0], POST, *MOVING[1:]))
MARK = scene_mark(o.name for o in SCENE.moving)


def sample(poses, number=3, **values):
    return MoverSample(number=number, poses_M=np.asarray(poses, float), **{"measured_s": 1.5, "scene": MARK, **values})


def at(time_s):
    return poses_of([o.at(time_s) for o in SCENE.moving])


def test_a_sample_there_and_back():
    back = MoverSample.decode(sample(at(0.7)).encode())
    assert (back.number, back.measured_s, back.scene) == (3, 1.5, MARK)
    np.testing.assert_allclose(back.poses_M, at(0.7), atol=1e-12)
    assert len(MoverSample.decode(sample(np.zeros((0, 7))).encode()).poses_M) == 0
    with pytest.raises(InvalidMessage, match="33 poses: at most 32"):
        sample(np.zeros((33, 7))).encode()


def test_a_program_without_hotice_writes_one():
    """As docs/deploy.md says."""
    names = ["ann_legs", "ann_trunk", "door"]
    poses = [[1.0, 2.0, 0.5, 1.0, 0.0, 0.0, 0.0]] * 3
    mark = zlib.crc32(b"".join(name.encode() + b"\0" for name in names))
    values = [number for pose in poses for number in pose] + [0.0] * (7 * (32 - len(poses)))
    body = struct.pack("<4sIdII224d", b"HTM1", 9, 12.5, mark, len(poses), *values)
    opened = MoverSample.decode(body + struct.pack("<I", zlib.crc32(body)))
    assert opened.scene == MARK and opened.poses_M.tolist() == poses


@pytest.mark.parametrize(
    ("wrong", "reason"),
    [
        (lambda poses: poses * np.nan, "number"),
        (lambda poses: poses + [np.inf, 0, 0, 0, 0, 0, 0], "number"),
        (lambda poses: poses * [1, 1, 1, 0, 0, 0, 0], "number"),
        (lambda poses: poses + [1e7, 0, 0, 0, 0, 0, 0], "number"),
    ],
)
def test_numbers_that_are_none_do_not_open(wrong, reason):
    with pytest.raises(InvalidMessage) as error:
        MoverSample.decode(sample(wrong(at(0.0))).encode())
    assert error.value.reason == reason


def test_damaged_samples_never_open(rng):
    whole = sample(at(0.3)).encode()
    for cut in (whole[:-1], whole + b"\0", b"HTP1" + whole[4:]):
        with pytest.raises(InvalidMessage):
            MoverSample.decode(cut)
    for _ in range(300):
        raw = bytearray(whole)
        raw[int(rng.integers(len(raw)))] ^= 1 << int(rng.integers(8))
        with pytest.raises(InvalidMessage):
            MoverSample.decode(bytes(raw))


class Watched:
    """A tracker, its source and their clock."""

    def __init__(self, source=None):
        self.clock, self.number = SimulatedClock(5.0), 0
        self.samples = MemorySource(self.clock, MoverSample.decode)
        self.tracker = MoverTracker(self.samples, SCENE.moving, source)

    def see(self, poses, late_s=0.1, **values):
        self.number += 1
        self.samples.send(sample(poses, self.number, measured_s=self.clock.now() - late_s, **values).encode())
        self.tracker.look(self.clock.now())


def test_all_go_on_as_students_are_trained_to_know_them():
    """Seen 10 times a second, 0.1 s late: the places of `hotice.model.moving.sight`, of a person and of a door."""
    watched, config = Watched(), MovingConfig()
    assert watched.tracker.age_s(5.0) == math.inf and watched.tracker.verdict == "not seen yet"
    for k in range(1, 61):
        time_s = 0.02 * k
        if k % 5 == 0:
            watched.see(at(max(time_s - 0.1, 0.0)))
        if k >= 15:
            known = poses_of(seen_moving(SCENE.moving, time_s, config.sensor_hz, config.sensor_delay_s))
            np.testing.assert_allclose(watched.tracker.poses(watched.clock.now()), known, atol=1e-6)
            assert 0.099 < watched.tracker.age_s(watched.clock.now()) < 0.181 and watched.tracker.verdict == "ok"
        watched.clock.sleep(0.02)
    # and no further than for a second when nothing more comes
    late = [watched.tracker.poses(watched.clock.now() + s) for s in (1.5, 3.0)]
    np.testing.assert_array_equal(*late)


def test_what_was_put_elsewhere_stays_there_and_what_is_of_another_scene_is_not_believed():
    watched = Watched()
    watched.see(at(0.0))
    watched.clock.sleep(0.1)
    away = at(0.1)
    away[2, :3] += [0.6, 0.0, 0.0]
    watched.see(away)
    np.testing.assert_allclose(watched.tracker.poses(watched.clock.now())[2], away[2])
    before, age_s = watched.tracker.newest, watched.tracker.age_s(watched.clock.now())
    watched.clock.sleep(0.1)
    for wrong, said in (
        (dict(poses=at(0.2), scene=MARK + 1), "of another scene"),
        (dict(poses=at(0.2)[:2]), "of another scene"),
        (dict(poses=at(0.2) + [2e3, 0, 0, 0, 0, 0, 0]), "more than 1000 m away"),
    ):
        watched.see(**wrong)
        assert watched.tracker.verdict == said and watched.tracker.newest is before
    assert watched.tracker.age_s(watched.clock.now()) == pytest.approx(age_s + 0.1)


def test_poses_are_those_of_the_map():
    turn = tuple(quat_from_axis_angle(np.array([1.0, 2.0, 0.5]), 1.1).tolist())
    source = MapSource(file="hall.pcd", sha256="0" * 64, unit_m=0.01, position_m=(0.4, -0.2, 1.3), quaternion_wxyz=turn)
    watched, inverse = Watched(source), np.array(turn) * [1, -1, -1, -1]
    poses_W = at(0.8)
    in_map = quat_rotate(inverse, poses_W[:, :3] - source.position_m) / source.unit_m
    watched.see(np.hstack([in_map, quat_mul(inverse, poses_W[:, 3:])]))
    np.testing.assert_allclose(watched.tracker.poses(watched.clock.now()), poses_W, atol=1e-9)


@pytest.fixture(scope="module")
def carry():
    return solved(BOX)


@pytest.fixture(scope="module")
def policy():
    return open_policy("student")


@pytest.fixture(scope="module")
def still(policy, carry):
    task = CarryPolicy(policy, carry).task
    return build_hod_pf(SCENE.still(), task.resolution_m, task.margin_m)


def test_fields_have_what_moves_and_its_ways_and_an_age(still):
    watched, ways = Watched(), ToldWays(still, SCENE.moving)
    around = Around(still, watched.tracker, ways)
    points = np.random.default_rng(0).uniform((-0.4, -0.9, 0.1), (2.4, 0.9, 1.4), (100, 3))
    around.look(watched.clock.now())
    assert around.fields is still and not around.sure and around.verdict == "not seen yet"
    watched.see(at(0.6), late_s=0.0)
    around.look(watched.clock.now())
    # seen, but no ways among it yet
    assert around.sure and around.verdict == "ok, without ways of the moment"
    bare = momentary_pf(still, moved(SCENE.moving, at(0.6)))
    np.testing.assert_array_equal(around.fields.sgf.query(points)[0], bare.sgf.query(points)[0])
    ways.tell(at(0.6), watched.clock.now())
    watched.clock.sleep(0.3)
    watched.see(at(0.9), late_s=0.0)
    around.look(watched.clock.now())
    then, now = (MomentaryScene("all", obstacles=(POST, *moved(SCENE.moving, at(t)))) for t in (0.6, 0.9))
    grid = (still.grid.resolution_m, still.margin_m)
    expected = momentary_pf(still, moved(SCENE.moving, at(0.9)), build_hod_pf(then, *grid))
    for ours, theirs in ((around.fields.sgf, expected.sgf), (around.fields.ogf, expected.ogf)):
        for a, b in zip(ours.query(points), theirs.query(points), strict=True):
            np.testing.assert_array_equal(a, b)
    np.testing.assert_allclose(around.fields.sgf.query(points)[1], now.signed_distance(points), atol=0.02)
    assert around.age_s == pytest.approx(0.0) and around.sure and around.verdict == "ok"
    # ways that are older than a second do not count any more
    watched.clock.sleep(0.8)
    around.look(watched.clock.now())
    assert around.built is None and around.verdict == "ok, without ways of the moment"
    assert around.age_s == pytest.approx(0.8)
    watched.clock.sleep(0.3)
    around.look(watched.clock.now())
    assert not around.sure and around.verdict == "seen 1 s ago"


def test_ways_of_a_process_beside_are_those_of_a_log(still):
    """Bit for bit, so that what was done by them can be done again; at most 5 a second are built."""
    told = ToldWays(still, SCENE.moving)
    with LiveWays(still, SCENE.moving) as live:
        assert live.newest() is None
        for k, t in enumerate((0.0, 0.3, 0.8)):
            live.show(at(t), 10.0 + 0.2 * k)
            live.show(at(t + 0.1), 10.1 + 0.2 * k)
            live.wait()
            built = live.newest()
            assert built.measured_s == 10.0 + 0.2 * k and np.array_equal(built.poses, at(t))
            told.tell(built.poses, built.measured_s)
            again = told.newest()
            for name in ("sgf", "ogf"):
                ours, theirs = getattr(built.fields, name), getattr(again.fields, name)
                points = np.random.default_rng(k).uniform((-0.4, -0.9, 0.1), (2.4, 0.9, 1.4), (200, 3))
                np.testing.assert_array_equal(ours.sample(points), theirs.sample(points))


def test_a_runner_goes_by_what_it_sees_and_stands_where_it_is_old(policy, still, carry, rng):
    """The guard is told the age as that of the place: at its limit it holds."""
    robot, watched = a_robot(carry, rng), Watched()
    desk = Desk(policy, still, carry, robot)
    watched.clock = desk.clock
    watched.samples = MemorySource(desk.clock, MoverSample.decode)
    watched.tracker = MoverTracker(watched.samples, SCENE.moving, None)
    desk.runner.around = Around(still, watched.tracker)
    desk.runner.warm()
    percept, ours = PerceptModel(carry.carried)(*robot.to_mujoco(29)), CarryPolicy(policy, carry)

    def ticked(mode=Mode.CARRY):
        desk.tick(Mode.READY, robot)  # forgets the action before
        return desk.tick(mode, robot)

    targets, blind = ticked(), read_fields(still, percept, ours.task)
    assert targets["pose_age_s"] == np.inf and targets["movers_old"]
    ours.reset()
    walking = desk.runner.all_joints(ours.act(percept, blind))
    assert np.abs(targets["q"] - walking).max() > 0.01
    watched.see(at(0.4), late_s=0.0)
    targets, now_s = ticked(), desk.clock.now() - 0.02
    fields = momentary_pf(still, moved(SCENE.moving, at(0.4)))
    reading = read_fields(fields, percept, ours.task)
    assert np.abs(reading.vector - blind.vector).max() > 0.05
    ours.reset()
    expected = desk.runner.all_joints(ours.act(percept, reading))
    np.testing.assert_allclose(targets["q"], expected, atol=1e-4)
    # localization is 0.1 s old here
    assert targets["pose_age_s"] == pytest.approx(max(0.1, watched.tracker.age_s(now_s))) and not targets["movers_old"]
    desk.clock.sleep(1.1)
    targets = ticked()
    assert targets["pose_age_s"] > 1.0 and targets["movers_old"] and np.abs(targets["q"] - expected).max() > 0.01


def thrown():
    """A ball comes at the chest in half a second."""
    ways = ((0.0, 2.2), (0.5, 0.4))
    course = Motion(way_points=tuple(WayPoint(time_s=t, position_m=(x, 0.0, 1.0)) for t, x in ways))
    return Scene("thrown", obstacles=(Obstacle("ball", "side", SphereShape(0.1), (2.2, 0.0, 1.0), motion=course),))


def test_a_simulated_robot_moves_them_on_the_scenes_clock_and_tells_where_they_were():
    lab = Lab(scene=SCENE, motions_from_s=0.1, seed=2)
    lab.live(0.1)
    np.testing.assert_allclose(lab.world.data.mocap_pos, at(0.0)[:, :3])
    lab.live(0.6, lab.holding())
    scene_s = lab.world.movers.time_s
    assert scene_s == pytest.approx(0.6, abs=0.003)
    np.testing.assert_allclose(lab.world.data.mocap_pos, at(scene_s)[:, :3], atol=1e-3)
    found = [lab.world.data.body(f"obstacle/{o.name}").xquat for o in SCENE.moving]
    np.testing.assert_allclose(np.abs((np.array(found) * at(scene_s)[:, 3:]).sum(axis=1)), 1.0, atol=1e-6)
    seen = lab.movers.newest()
    assert lab.movers.counts().taken == 7 and seen.sample.scene == MARK
    # measured at 0.6 s, come at 0.7 s
    assert seen.sample.measured_s == pytest.approx(0.6, abs=STEP_S)
    np.testing.assert_allclose(seen.sample.poses_M, at(0.5), atol=4e-3)


def test_motions_begin_with_the_keys_of_the_carry():
    lab = Lab(scene=SCENE, press=("R1+X@0.2s",))
    lab.live(0.2, lab.holding())
    assert not lab.world.movers.under_way
    lab.live(0.3, lab.holding())
    assert lab.world.movers.time_s == pytest.approx(0.3, abs=0.005)


def test_who_sees_them_may_fall_silent_or_say_nonsense():
    lab = Lab(scene=SCENE, fault=("movers-loss@0.3s+0.3s", "movers-nan@0.8s"))
    lab.live(0.45)
    before = lab.movers.newest().number
    lab.live(0.2)
    assert lab.movers.newest().number == before and lab.movers.counts().refused == {}
    lab.live(0.2)
    assert lab.movers.newest().number > before
    lab.live(0.4)
    assert lab.movers.counts().refused == {"number": 4}


def test_who_stands_is_walked_into():
    lab = Lab(scene=thrown(), motions_from_s=0.3)
    lab.live(0.9, lab.holding())
    assert lab.world.touched == "walked_into" and lab.robot.story.touched[0] == "walked_into"


def test_a_scene_in_which_nothing_moves_has_no_samples():
    lab = Lab(scene=replace(SCENE, obstacles=(POST,)))
    lab.live(0.3)
    assert lab.movers.counts().taken == 0 and lab.robot.mover_sight is None


def test_turns_of_more_than_half_a_turn_are_the_short_way():
    """A quaternion and its negative are one orientation."""
    watched, poses = Watched(), at(0.0)
    for yaw, sign in ((3.0, 1.0), (3.3, -1.0)):
        poses[2, 3:] = sign * quat_from_yaw(yaw)
        watched.see(poses, late_s=0.0)
        watched.clock.sleep(0.1)
    turned = watched.tracker.poses(watched.clock.now())[2, 3:]
    assert abs(turned @ quat_from_yaw(3.6)) == pytest.approx(1.0)
