"""The estimator: the pelvis from the lidar, tracking as in training, and what it does with poses that are wrong."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from hotice.deploy.camera import HEAD_CAMERA
from hotice.deploy.clock import SimulatedClock
from hotice.deploy.estimate import LidarPelvis, SeenPose, TaggedBox, TrackingEstimator
from hotice.deploy.estimate.pelvis import pelvis_in_scene
from hotice.deploy.frames import WAIST, Pose, camera_in_pelvis
from hotice.deploy.messages.hg import JOINTS
from hotice.deploy.past import Past, Torso, measured_at
from hotice.deploy.sources import MemorySource, PoseSample, TagSample
from hotice.deploy.tags import BoxPoser, TagBox, box_bundle
from hotice.model import builder, g1
from hotice.model.frames import (
    mat_to_quat,
    quat_conj,
    quat_from_axis_angle,
    quat_from_yaw,
    quat_mul,
    quat_rotate,
    quat_to_mat,
    yaw_from_quat,
)
from hotice.model.objects import Box
from hotice.model.robot_state import RobotState
from hotice.model.source import MapSource
from hotice.policy import PerceptModel
from hotice.policy.measuring import DRAWS, ESTIMATE, attitude, measure
from hotice.task.sensing import STUDENT_SENSING, TRACK_TILT
from tests.deploy.messages_fixture import state_of

BOX = Box((0.3, 0.3, 0.25), 1.5)
DT_S = 0.02
UP = np.array([0.0, 0.0, 1.0])


def a_robot(rng, p_WP=(1.0, -0.5, 0.72), yaw=-2.0):
    quat_WP = quat_mul(quat_from_yaw(yaw), quat_from_axis_angle(np.array([0.6, -0.8, 0.0]), 0.1))
    joints = 0.1 * rng.normal(size=29)
    return RobotState(
        p_WP=np.array(p_WP),
        quat_WP=quat_WP,
        w_WP_P=0.3 * rng.normal(size=3),
        joint_pos=joints,
        joint_vel=rng.normal(size=29),
        carried=BOX,
        p_WO=np.array(p_WP) + quat_rotate(quat_WP, [0.3, 0.02, 0.1]),
        quat_WO=quat_mul(quat_WP, quat_from_yaw(0.05)),
    )


class Poses:
    """Sources of an estimator, turned by hand."""

    def __init__(self, robot):
        self.pelvis = SeenPose(robot.p_WP, robot.quat_WP, 0.0)
        back = quat_conj(robot.quat_WP)
        self.box = SeenPose(quat_rotate(back, robot.p_WO - robot.p_WP), quat_mul(back, robot.quat_WO), 0.0)
        self.estimator = TrackingEstimator(BOX, lambda *_: self.pelvis, lambda *_: self.box)


def still(rng):
    return replace(a_robot(rng), w_WP_P=np.zeros(3))


def test_the_first_percept_is_that_of_the_true_state(rng):
    """Whatever heading the IMU believes in."""
    robot = a_robot(rng)
    for yaw in (0.0, 0.7, -3.0):
        estimate = Poses(robot).estimator.update(state_of(robot, yaw), 0.3)
        true = PerceptModel(BOX)(*robot.to_mujoco(29))
        np.testing.assert_allclose(estimate.percept.vector, true.vector, atol=2e-6)
        assert estimate.pose_age_s == estimate.box_age_s == 0.3 and not estimate.disputed


def test_the_same_numbers_as_in_training(rng):
    """A walk along a circle, measured by the sensor model of training, and by the estimator from the same inputs."""
    # gravity comes as an attitude here, of length 1; the guard of jumps refuses the trained noise of the object
    config = replace(STUDENT_SENSING, gravity=0.0, object_pos_m=0.01, object_rot_rad=0.03)
    model = PerceptModel(BOX)
    poses = Poses(a_robot(rng))
    estimate, walked = np.zeros(ESTIMATE), []
    hold = config.hold_steps(DT_S)
    for count in range(40):
        along = 0.012 * count
        robot = a_robot(rng, p_WP=(np.sin(along), 1.0 - np.cos(along), 0.72 + 0.02 * np.sin(3 * along)), yaw=along)
        qpos, qvel = robot.to_mujoco(29)
        true, draws = model(qpos, qvel), rng.uniform(-1.0, 1.0, DRAWS)
        theirs, estimate = measure(
            true,
            estimate,
            draws,
            config,
            world_aligned=False,
            keypoints=model.keypoints_at(qpos),
            refresh=count % hold == 0,
            gain=max(config.object_gain(DT_S), 1.0 / (count + 1)),
            tilt_gain=max(TRACK_TILT, 1.0 / (count + 1)),
            hold_s=hold * DT_S,
            dt_s=DT_S if count else 0.0,
        )
        now_s = DT_S * count
        if count % hold == 0:
            seen = true.p_WP + config.root_pos_m * draws[1:4], true.yaw[0] + config.root_yaw_rad * draws[0]
            poses.pelvis = SeenPose(seen[0], quat_from_yaw(seen[1]), now_s)
        R_PW = attitude(true.yaw[0], true.gravity_P).T
        tilt = config.object_rot_rad * draws[33:36]
        R_tilt = quat_to_mat(quat_from_axis_angle(tilt, np.linalg.norm(tilt)))
        p_PO = R_PW @ (true.p_WO - true.p_WP + config.object_pos_m * draws[30:33])
        poses.box = SeenPose(p_PO, mat_to_quat(R_PW @ R_tilt @ true.R_WO), now_s)
        measured = robot.joint_pos.copy()
        measured[model._q - 7] = theirs.q
        state = state_of(replace(robot, joint_pos=measured, w_WP_P=theirs.w_WP_P))
        state["motor_state"][JOINTS]["dq"][model._q - 7] = theirs.qd
        ours = poses.estimator.update(state, now_s).percept
        for name in theirs.PARTS:
            np.testing.assert_allclose(getattr(ours, name), getattr(theirs, name), atol=5e-6, err_msg=f"{name} {count}")
        walked.append(theirs.p_WP - true.p_WP)
    # the noise was there
    assert np.abs(walked).max() > 0.005


def sample_of(robot, source=None, number=1):
    """Pose sample of a robot, its lidar placed by MuJoCo's kinematics and the maker's numbers."""
    model = builder.build_model(BOX, joints=29, floor=False)
    data = mujoco.MjData(model)
    data.qpos[:] = robot.to_mujoco(29)[0]
    mujoco.mj_kinematics(model, data)
    torso = data.body(g1.TORSO_BODY)
    # the lidar on the torso, roll π and pitch 0.0511 rad; its IMU from FAST-LIO's mid360.yaml
    quat_TL = quat_mul(quat_from_axis_angle(np.array([0.0, 1.0, 0.0]), 0.0511), np.array([0.0, 1.0, 0.0, 0.0]))
    p_TL = np.array([0.0003, 0.0, 0.4284]) + quat_rotate(quat_TL, [0.011, 0.0233, -0.0441])
    p_WL, quat_WL = torso.xpos + quat_rotate(torso.xquat, p_TL), quat_mul(torso.xquat, quat_TL)
    if source is not None:
        back = quat_conj(np.array(source.quaternion_wxyz))
        p_WL = quat_rotate(back, p_WL - source.position_m) / source.unit_m
        quat_WL = quat_mul(back, quat_WL)
    return PoseSample(number=number, measured_s=0.0, p_ML=p_WL, quat_ML=quat_WL)


MAP = MapSource(
    file="map.pcd",
    sha256="0" * 64,
    unit_m=0.01,
    position_m=(2.0, -1.0, 1.2),
    quaternion_wxyz=tuple(quat_mul(quat_from_yaw(0.4), np.array([0.0, 1.0, 0.0, 0.0])).tolist()),
)


@pytest.mark.parametrize("source", [None, MAP], ids=["scene", "map"])
@pytest.mark.parametrize("waist", [(0.0, 0.0, 0.0), (0.5, -0.2, 0.3)], ids=["straight", "bent"])
def test_the_pelvis_from_the_lidar(rng, source, waist):
    robot = a_robot(rng)
    joints = robot.joint_pos.copy()
    joints[list(WAIST)] = waist
    robot = replace(robot, joint_pos=joints)
    sample = sample_of(robot, source)
    X_WP = pelvis_in_scene(sample, source, np.array(waist))
    np.testing.assert_allclose(X_WP.p, robot.p_WP, atol=1e-6)
    np.testing.assert_allclose(X_WP.R, quat_to_mat(robot.quat_WP), atol=1e-6)
    if any(waist):
        # who takes a bent waist for a straight one is turned and off
        wrong = pelvis_in_scene(sample, source, np.zeros(3))
        assert np.trace(wrong.R.T @ X_WP.R) < 1.0 + 2.0 * np.cos(0.5) and np.linalg.norm(wrong.p - X_WP.p) > 0.015


def test_the_lidars_imu_is_not_the_lidar(rng):
    """Where the IMU of a standing robot is, as published; who forgets its offset from the lidar is 5 cm off."""
    imu = np.array([0.0096, -0.0233, 0.5159])
    quat = quat_mul(quat_from_axis_angle(np.array([0.0, 1.0, 0.0]), 0.0511), np.array([0.0, 1.0, 0.0, 0.0]))
    pelvis = np.array([1.0, 2.0, 0.74])
    sample = PoseSample(number=1, measured_s=0.0, p_ML=pelvis + imu, quat_ML=quat)
    np.testing.assert_allclose(pelvis_in_scene(sample, None, np.zeros(3)).p, pelvis, atol=1e-4)
    lidar = replace(sample, p_ML=pelvis + [-0.0037, 0.0, 0.4724])
    off = np.linalg.norm(pelvis_in_scene(lidar, None, np.zeros(3)).p - pelvis)
    assert off == pytest.approx(0.051, abs=0.002)


def test_a_map_that_leans_is_no_map(rng):
    clock = SimulatedClock()
    source = MemorySource(clock, PoseSample.decode)
    look, robot = LidarPelvis(source, None), still(rng)
    past = Past()
    past.add(Torso(robot.joint_pos[list(WAIST)], quat_to_mat(robot.quat_WP)[2]), 0.0)
    assert look(past, 0.0) is None
    for number, lean in enumerate((np.radians(7.0), np.radians(9.0))):
        clock.sleep(0.1)
        tilted = replace(robot, quat_WP=quat_mul(quat_from_axis_angle(np.array([1.0, 0.0, 0.0]), lean), robot.quat_WP))
        source.send(sample_of(tilted, number=number + 1).encode())
        seen = look(past, clock.now())
        assert seen.good is (number == 0) and seen.received_s == clock.now()
    assert "leans 9 degrees" in seen.verdict


def test_the_box_from_its_tags(rng):
    pytest.importorskip("cv2")
    clock, bundle = SimulatedClock(), box_bundle(BOX)
    source = MemorySource(clock, TagSample.decode)
    look = TaggedBox(source, BoxPoser(bundle))
    waist = np.array([0.1, 0.05, -0.1])
    X_PO = Pose(quat_to_mat(quat_from_axis_angle(UP, 0.1)), np.array([0.32, 0.01, 0.12]))
    past = Past()
    past.add(Torso(waist, UP), 0.0)
    assert look(past, 0.0) is None
    pixels = HEAD_CAMERA.pixels((camera_in_pelvis(waist).inverse @ X_PO).points(bundle.corners_O[:4]))
    source.send(TagSample(number=1, measured_s=0.0, ids=np.arange(4), corners_px=pixels).encode())
    seen = look(past, 0.0)
    np.testing.assert_allclose(seen.p, X_PO.p, atol=1e-5)
    np.testing.assert_allclose(quat_to_mat(seen.quat), X_PO.R, atol=1e-4)
    clock.sleep(0.1)
    source.send(TagSample(number=2, measured_s=0.1, ids=np.zeros(0, int), corners_px=np.zeros((0, 4, 2))).encode())
    assert look(past, 0.1).verdict == "none seen" and not look(past, 0.1).good


@pytest.mark.parametrize("same_clock", [True, False], ids=["stamped by our clock", "by another, its latency known"])
@pytest.mark.parametrize("kind", ["look", "tag box"])
def test_a_moving_waist_counts_as_it_was_at_the_exposure(kind, same_clock):
    """At 0.5 rad/s and 50 ms of latency: 1 mm; by the newest state it would be some 10 mm."""
    pytest.importorskip("cv2")
    clock, bundle, latency_s, late = SimulatedClock(), box_bundle(BOX), 0.05, []
    source = MemorySource(clock, TagSample.decode)
    known = {"latency_s": 0.0 if same_clock else latency_s}
    look, box = TaggedBox(source, BoxPoser(bundle), **known), TagBox(source, BoxPoser(bundle), **known)
    X_PO, past, off = Pose(np.eye(3), np.array([0.32, 0.01, 0.12])), Past(), {"then": [], "newest": []}
    robot = still(np.random.default_rng(0))
    for step in range(60):
        now_s = clock.now()
        waist = np.array([0.5 * now_s, 0.1 * np.sin(5.0 * now_s), 0.05])
        pixels = HEAD_CAMERA.pixels((camera_in_pelvis(waist).inverse @ X_PO).points(bundle.corners_O[:4]))
        stamp_s = now_s if same_clock else now_s + 1e5
        late.append(TagSample(number=step + 1, measured_s=stamp_s, ids=np.arange(4), corners_px=pixels).encode())
        if step > 5:
            source.send(late[step - 5])
        # a runner reads a state every 20 ms, pictures come between them
        if step % 2 == 0:
            state = state_of(replace(robot, quat_WP=np.array([1.0, 0.0, 0.0, 0.0])))
            state["motor_state"]["q"][list(WAIST)] = waist
            past.add(Torso.of(state), now_s)
            alone = Past()
            alone.add(Torso.of(state), now_s)
            seen = look(past, now_s) if kind == "look" else box.update(state, now_s)
            other = TaggedBox(source, BoxPoser(bundle), **known)(alone, now_s)
            if seen is not None and step > 10:
                off["then"].append(np.linalg.norm((seen.p if kind == "look" else seen.X_PO.p) - X_PO.p))
                off["newest"].append(np.linalg.norm(other.p - X_PO.p))
        clock.sleep(0.01)
    assert len(off["then"]) > 20 and max(off["then"]) < 1e-3 and min(off["newest"]) > 5e-3


@pytest.mark.parametrize("same_clock", [True, False], ids=["stamped by our clock", "by another, its latency known"])
def test_a_pose_counts_from_when_it_was_measured(same_clock):
    """A robot that walks at 0.6 m/s, its poses 60 ms late: without their stamps it would be 3.6 cm behind."""
    clock, late, robot = SimulatedClock(), [], still(np.random.default_rng(0))
    source, latency_s = MemorySource(clock, PoseSample.decode), 0.0 if same_clock else 0.06
    look = LidarPelvis(source, None, latency_s=latency_s)
    box = SeenPose(np.array([0.3, 0.0, 0.1]), np.array([1.0, 0.0, 0.0, 0.0]), 0.0)
    ours = TrackingEstimator(BOX, look, lambda *_: box, latency_s=latency_s)
    off = []
    for step in range(100):
        now_s = clock.now()
        walks = replace(robot, p_WP=robot.p_WP + [0.6 * now_s, 0.0, 0.0])
        if step % 5 == 0:
            sample = sample_of(walks, number=step // 5 + 1)
            late.append((now_s + 0.06, replace(sample, measured_s=now_s + (0.0 if same_clock else 1e5)).encode()))
        while late and late[0][0] <= now_s + 1e-9:
            source.send(late.pop(0)[1])
        estimate = ours.update(state_of(walks), now_s)
        # the velocity of the root is found by then
        if step > 70:
            off.append(estimate.percept.p_WP[0] - walks.p_WP[0])
        clock.sleep(0.02)
    assert np.abs(off).max() < 5e-3


def test_the_past_is_a_ring_by_time():
    past, up = Past(), np.array([0.0, 0.0, 1.0])
    for k in range(200):
        past.add(Torso(np.array([0.01 * k, 0.0, 0.0]), up), 0.02 * k)
    assert past.newest.waist[0] == pytest.approx(1.99) == past.at(99.0).waist[0]
    assert past.at(3.57).waist[0] == pytest.approx(1.785)
    assert past.at(0.0).waist[0] == pytest.approx(1.36)
    # the same state again, and a clock that begins anew
    past.add(Torso(np.array([5.0, 0.0, 0.0]), up), 0.02 * 199)
    assert past.newest.waist[0] == 5.0 and past.at(0.02 * 198).waist[0] == pytest.approx(1.98)
    past.add(Torso(np.array([7.0, 0.0, 0.0]), up), 0.1)
    assert past.at(3.9).waist[0] == 7.0 == past.at(0.0).waist[0]


@pytest.mark.parametrize(
    ("measured_s", "found_s"), [(9.98, 9.98), (9.0, 9.0), (10.0, 10.0), (10.1, 9.95), (8.9, 9.95), (1e9, 9.95)]
)
def test_whose_clock_a_sample_is_stamped_by(measured_s, found_s):
    assert measured_at(measured_s, 9.99, 10.0, 0.04) == pytest.approx(found_s)


def test_nothing_is_believed_before_both_were_seen(rng):
    robot = a_robot(rng)
    for missing in ("pelvis", "box"):
        poses = Poses(robot)
        setattr(poses, missing, None)
        assert poses.estimator.update(state_of(robot), 0.0) is None


def test_one_pose_elsewhere_is_refused_and_forgotten(rng):
    robot = still(rng)
    poses, state = Poses(robot), state_of(robot)
    poses.estimator.update(state, 0.0)
    for i, off in enumerate((0.16, 0.0, 0.16, 0.0), start=1):
        poses.pelvis = SeenPose(robot.p_WP + [off, 0.0, 0.0], robot.quat_WP, 0.1 * i)
        estimate = poses.estimator.update(state, 0.1 * i)
        assert estimate.percept.p_WP[0] == pytest.approx(robot.p_WP[0], abs=1e-6) and not estimate.disputed
        assert estimate.pose_verdict == ("elsewhere than tracking" if off else "ok")


def test_five_poses_elsewhere_are_a_dispute(rng):
    robot = still(rng)
    poses, true, state = Poses(robot), robot.p_WP, state_of(robot)
    estimator = poses.estimator
    estimator.update(state, 0.0)
    for i in range(1, 6):
        poses.pelvis = SeenPose(true + [0.16, 0.0, 0.0], robot.quat_WP, 0.1 * i)
        for _ in range(5):  # one that is read again does not count again
            estimate = estimator.update(state, 0.1 * i)
        assert estimate.percept.p_WP[0] == pytest.approx(true[0], abs=1e-6) and estimate.disputed is (i == 5)
        assert estimate.pose_age_s == pytest.approx(0.1 * i if i < 5 else 0.0)
    estimator.acknowledge()
    for i in range(6, 12):
        poses.pelvis = SeenPose(true + [0.16, 0.0, 0.0], robot.quat_WP, 0.1 * i)
        estimate = estimator.update(state, 0.1 * i)
        assert not estimate.disputed and estimate.pose_age_s < 0.51, "it is known, and told once"
        assert estimate.percept.p_WP[0] == pytest.approx(true[0], abs=1e-6)
    estimator.settle()
    settled = estimator.update(state, 1.12)
    assert settled.percept.p_WP[0] == pytest.approx(true[0] + 0.16, abs=1e-6) and not settled.disputed


def test_a_turn_that_no_gyro_felt_is_refused_then_a_dispute(rng):
    """While the robot turns as fast as its gyro says, nothing is refused."""
    robot = still(rng)
    poses, state = Poses(robot), state_of(robot)
    poses.estimator.update(state, 0.0)
    for i in range(1, 6):
        poses.pelvis = SeenPose(robot.p_WP, quat_mul(quat_from_yaw(3.0), robot.quat_WP), 0.1 * i)
        estimate = poses.estimator.update(state, 0.1 * i)
        turned = estimate.percept.yaw[0] - yaw_from_quat(robot.quat_WP)
        assert estimate.disputed is (i == 5) and np.cos(turned) > 0.999
    poses.estimator.settle()
    assert np.cos(poses.estimator.update(state, 0.52).percept.yaw[0] - yaw_from_quat(robot.quat_WP) - 3.0) > 0.999
    turning = replace(a_robot(rng), quat_WP=quat_from_yaw(0.0), w_WP_P=np.array([0.0, 0.0, 2.0]))
    poses = Poses(turning)
    for i in range(30):
        quat = quat_from_yaw(2.0 * 0.02 * i)
        poses.pelvis = SeenPose(turning.p_WP, quat, 0.02 * (i - i % 5))
        estimate = poses.estimator.update(state_of(replace(turning, quat_WP=quat)), 0.02 * i)
        assert estimate.pose_verdict == "ok" and not estimate.disputed


def test_a_box_that_is_not_seen_moves_with_the_pelvis(rng):
    robot = still(rng)
    poses = Poses(robot)
    before = poses.estimator.update(state_of(robot), 0.0)
    poses.pelvis = SeenPose(robot.p_WP + [0.05, 0.0, 0.0], robot.quat_WP, 0.1)
    poses.box = SeenPose(np.full(3, np.nan), np.full(4, np.nan), 0.1, "none seen")
    after = poses.estimator.update(state_of(robot), 0.12)
    moved = after.percept.p_WP - before.percept.p_WP
    assert moved[0] == pytest.approx(0.7 * 0.05)
    np.testing.assert_allclose(after.percept.p_WO - before.percept.p_WO, moved, atol=1e-6)
    assert after.box_age_s == pytest.approx(0.12) and after.pose_age_s == pytest.approx(0.02)
    assert after.box_verdict == "none seen"


def test_a_box_that_jumps_is_refused(rng):
    robot = still(rng)
    poses = Poses(robot)
    before = poses.estimator.update(state_of(robot), 0.0).percept.p_WO.copy()
    poses.box = SeenPose(poses.box.p + [0.11, 0.0, 0.0], poses.box.quat, 0.02)
    after = poses.estimator.update(state_of(robot), 0.02)
    np.testing.assert_allclose(after.percept.p_WO, before, atol=1e-6)
    assert after.box_verdict == "jumped" and after.box_age_s == pytest.approx(0.02)


def test_who_is_lost_is_taken_to_stand(rng):
    """Between poses it goes on as it walked; when two are missing its legs say how far, and these stand."""
    robot = still(rng)
    poses, speed = Poses(robot), 0.5
    poses.estimator._root._latency_s = 0.0
    for i in range(50):
        if i % 5 == 0:
            poses.pelvis = SeenPose(robot.p_WP + [0.02 * i * speed, 0.0, 0.0], robot.quat_WP, 0.02 * i)
        estimate = poses.estimator.update(state_of(robot), 0.02 * i)
    places = [estimate.percept.p_WP[0]]
    for i in range(50, 150):
        places.append(poses.estimator.update(state_of(robot), 0.02 * i).percept.p_WP[0])
    steps = np.diff(places)
    np.testing.assert_allclose(steps[:8], 0.02 * speed, rtol=0.05)
    np.testing.assert_allclose(steps[8:], 0.0, atol=1e-9)


def test_a_known_latency_is_made_up_for(rng):
    robot, off = still(rng), {}
    for latency_s in (0.0, 0.1):
        poses = Poses(robot)
        estimator = TrackingEstimator(BOX, lambda *_, p=poses: p.pelvis, lambda *_, p=poses: p.box, latency_s=latency_s)
        for i in range(200):
            if i % 5 == 0:
                poses.pelvis = SeenPose(robot.p_WP + [0.5 * (0.02 * i - 0.1), 0.0, 0.0], robot.quat_WP, 0.02 * i)
            estimate = estimator.update(state_of(robot), 0.02 * i)
        off[latency_s] = estimate.percept.p_WP[0] - robot.p_WP[0] - 0.5 * 0.02 * 199
    assert off[0.0] == pytest.approx(-0.05, abs=1e-3) and off[0.1] == pytest.approx(0.0, abs=1e-3)
