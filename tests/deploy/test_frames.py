import mujoco
import numpy as np
import pytest

from hotice.deploy.camera import HEAD_CAMERA
from hotice.deploy.frames import Pose, camera_in_pelvis, lidar_in_pelvis, torso_in_pelvis
from hotice.deploy.tags import box_bundle
from hotice.errors import InvalidConfig, InvalidState
from hotice.model import builder, g1
from hotice.model.frames import quat_from_axis_angle
from hotice.model.objects import Box


def test_the_torso_is_where_mujoco_has_it(rng):
    model = builder.build_model(None, joints=29, floor=False)
    data = mujoco.MjData(model)
    waist = rng.uniform(-0.5, 0.5, 3)
    for joint, angle in zip(g1.WAIST_JOINTS, waist, strict=True):
        data.joint(joint).qpos[:] = angle
    data.qpos[3:7] = quat_from_axis_angle(rng.normal(size=3), 0.7)
    mujoco.mj_kinematics(model, data)
    pelvis, torso = (Pose(data.body(b).xmat.reshape(3, 3), data.body(b).xpos) for b in ("pelvis", "torso_link"))
    found, wished = torso_in_pelvis(waist), pelvis.inverse @ torso
    assert found.R == pytest.approx(wished.R, abs=1e-12)
    assert found.p == pytest.approx(wished.p, abs=1e-12)


def test_lidar_and_camera_with_a_straight_waist():
    """Measured places in the pelvis (docs of the description): the lidar's IMU and the camera's axis."""
    lidar, camera = lidar_in_pelvis(np.zeros(3)), camera_in_pelvis(np.zeros(3))
    assert lidar.p == pytest.approx([0.0096, -0.0233, 0.5159], abs=2e-4)
    # upside down, and tilted by 2.9 degrees
    assert lidar.R[:, 2] == pytest.approx([-0.051, 0.0, -0.9987], abs=1e-3)
    assert camera.p == pytest.approx([0.0537, 0.0175, 0.4739], abs=2e-4)
    assert camera.R[:, 2] == pytest.approx([0.67, 0.0, -0.74], abs=5e-3)
    # x of the picture is the robot's right
    assert camera.R[:, 0] == pytest.approx([0.0, -1.0, 0.0])


def test_poses_compose(rng):
    a, b = (Pose.of(rng.normal(size=3), quat_from_axis_angle(rng.normal(size=3), 1.0)) for _ in range(2))
    points = rng.normal(size=(5, 3))
    assert (a @ b).points(points) == pytest.approx(a.points(b.points(points)))
    assert (a @ a.inverse).p == pytest.approx(np.zeros(3), abs=1e-12)
    assert Pose.of(a.p, a.quat).R == pytest.approx(a.R)


def test_a_waist_of_another_size_is_told():
    with pytest.raises(InvalidState, match=r"\(2,\)"):
        torso_in_pelvis(np.zeros(2))


def test_tags_lie_on_the_box():
    box = Box((0.3, 0.3, 0.25), 1.5)
    bundle = box_bundle(box)
    top, near = bundle.corners_O[:4], bundle.corners_O[4:]
    assert top[..., 2] == pytest.approx(0.125) and near[..., 0] == pytest.approx(-0.15)
    assert top[..., 0].min() > -0.03 and top[..., 0].max() < 0.1
    for corners, normal in zip(bundle.corners_O, bundle.normals_O, strict=True):
        sides = np.roll(corners, -1, axis=0) - corners
        assert np.linalg.norm(sides, axis=1) == pytest.approx(0.05)
        # clockwise as one looks at it
        assert np.cross(sides[0], sides[1]) / 0.05**2 == pytest.approx(-normal)
    # the first tag of each sheet is at the upper left of a robot that stands behind the box
    assert top[0].mean(axis=0)[1] > 0 and top[0].mean(axis=0)[0] > top[2].mean(axis=0)[0]
    with pytest.raises(InvalidConfig, match="0.14"):
        box_bundle(Box((0.3, 0.3, 0.1), 1.5))


def test_a_pixel_by_hand():
    pixels = HEAD_CAMERA.pixels([[0.1, -0.05, 0.5], [0.0, 0.0, -1.0]])
    assert pixels[0] == pytest.approx([319.5 + 607.0 * 0.2, 239.5 - 607.0 * 0.1])
    assert np.isnan(pixels[1]).all()
    assert HEAD_CAMERA.inside([[0.0, 479.0], [640.0, 0.0], [np.nan, 1.0]]).tolist() == [True, False, False]
