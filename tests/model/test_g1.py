"""The robot description against Unitree's published one, and the same robot in MuJoCo, Pinocchio and Drake."""

import re
import subprocess
import sys
from pathlib import Path

import mujoco
import numpy as np
import pytest

from hotice.errors import UnknownName
from hotice.model import builder, g1
from hotice.model.frames import GRAVITY, normalize, quat_conj, quat_rotate, quat_to_mat
from hotice.model.objects import Box

pin = pytest.importorskip("pinocchio")
URDF_MASS_KG = 33.341142
PUBLISHED_EFFORT = {  # N m, by the end of the joint's name
    "hip_pitch": 88,
    "hip_roll": 139,
    "hip_yaw": 88,
    "knee": 139,
    "ankle_pitch": 35,
    "ankle_roll": 35,
    "waist_yaw": 88,
    "waist_roll": 35,
    "waist_pitch": 35,
    "shoulder_pitch": 25,
    "shoulder_roll": 25,
    "shoulder_yaw": 25,
    "elbow": 25,
    "wrist_roll": 25,
    "wrist_pitch": 5,
    "wrist_yaw": 5,
}
RAISED_EFFORT = {"ankle_pitch": 50, "ankle_roll": 50, "waist_roll": 50, "waist_pitch": 50}
"""Ours: both motors of the parallel ankle (and waist), as later descriptions of the same robot state them."""
KEYPOINT_BODY = {
    "head": "torso_link",
    "left_shoulder": "left_shoulder_roll_link",
    "torso": "torso_link",
    "pelvis": "pelvis",
    "left_knee": "left_knee_link",
    "left_foot": "left_ankle_roll_link",
    "left_hand": "left_wrist_yaw_link",
    "left_toe": "left_ankle_roll_link",
    "left_heel": "left_ankle_roll_link",
}
COVER_M = 0.0155
"""Measured: no vertex of any shell lies farther outside its link's primitives (worst 15.2 mm, shoulder_pitch)."""


def prefix() -> Path:
    """The `share` folder of the Pinocchio packages."""
    folder = Path(pin.__file__).parents[4] / "share"
    if not (folder / "example-robot-data").is_dir():
        pytest.skip("example-robot-data is not installed")
    return folder


@pytest.fixture(scope="module")
def urdf_path():
    return prefix() / "example-robot-data" / "robots" / "g1_description" / "urdf" / "g1_29dof_rev_1_0.urdf"


@pytest.fixture(scope="module")
def urdf(urdf_path):
    """The published robot; links behind fixed joints are merged into the moving ones."""
    return pin.buildModelFromUrdf(str(urdf_path), pin.JointModelFreeFlyer())


@pytest.fixture(scope="module")
def model():
    return builder.build_model(joints=29, floor=False)


def body_of(joint: str) -> str:
    """Name of the body that the joint moves."""
    if joint in ("root_joint", "floating_base"):
        return g1.ROOT_BODY
    return {"waist_pitch_joint": g1.TORSO_BODY}.get(joint, joint.replace("_joint", "_link"))


def random_states(model: mujoco.MjModel, count: int, seed: int = 0):
    """Configurations within the limits and velocities, in MuJoCo's order."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        joints = rng.uniform(model.jnt_range[1:, 0], model.jnt_range[1:, 1])
        q = np.concatenate([rng.uniform(-2, 2, 3), normalize(rng.normal(size=4)), joints])
        yield q, rng.uniform(-2, 2, model.nv)


def to_pinocchio(q, v):
    """MuJoCo (p, wxyz, joints), (v world, ω body) -> Pinocchio (p, xyzw, joints), (v body, ω body)."""
    v_P = quat_rotate(quat_conj(q[3:7]), v[:3])
    return np.concatenate([q[:3], q[4:7], q[3:4], q[7:]]), np.concatenate([v_P, v[3:]])


def to_drake(q, v):
    """MuJoCo -> Drake (wxyz, p, joints), (ω world, v world, joints)."""
    return np.concatenate([q[3:7], q[:3], q[7:]]), np.concatenate([quat_rotate(q[3:7], v[3:6]), v[:3], v[6:]])


def base_change(q, target: str) -> np.ndarray:
    """Matrix T with v_target = T v_mujoco, (nv, nv)."""
    nv = len(q) - 1
    change, R = np.eye(nv), quat_to_mat(q[3:7])
    if target == "pinocchio":
        change[:3, :3] = R.T
    else:
        change[:6, :6] = 0
        change[:3, 3:6], change[3:6, :3] = R, np.eye(3)
    return change


# Against the published description


def test_mass_and_joint_order(model, urdf):
    joints = [n for n in urdf.names if n not in ("universe", "root_joint")]
    assert tuple(joints) == g1.ALL_JOINTS
    assert tuple(model.joint(i).name for i in range(1, model.njnt)) == g1.ALL_JOINTS
    assert tuple(model.joint(int(i)).name for i in model.actuator_trnid[:, 0]) == g1.ALL_JOINTS
    assert model.body_mass.sum() == pytest.approx(URDF_MASS_KG, abs=1e-6)
    assert sum(i.mass for i in urdf.inertias) == pytest.approx(URDF_MASS_KG, abs=1e-6)
    assert len(g1.ACTION_JOINTS) == 20 and set(g1.ACTION_JOINTS) | set(g1.LOCKED_JOINTS) == set(g1.ALL_JOINTS)


def test_inertia_of_every_body(model, urdf):
    """Mass, centre of mass and inertia about it, in the body frame, to 1e-6 (kg, m, kg m^2)."""
    for joint, inertia in zip(urdf.names[1:], list(urdf.inertias)[1:], strict=True):
        body = model.body(body_of(joint))
        R = quat_to_mat(body.iquat)
        np.testing.assert_allclose(body.mass, inertia.mass, atol=1e-6)
        np.testing.assert_allclose(body.ipos, inertia.lever, atol=1e-6)
        np.testing.assert_allclose(R @ np.diag(body.inertia) @ R.T, inertia.inertia, atol=1e-6, err_msg=joint)


def test_position_limits(model, urdf):
    for joint in g1.ALL_JOINTS:
        at = urdf.joints[urdf.getJointId(joint)].idx_q
        limits = urdf.lowerPositionLimit[at], urdf.upperPositionLimit[at]
        np.testing.assert_allclose(model.joint(joint).range, limits, atol=1e-9, err_msg=joint)
    assert model.jnt_limited[1:].all()


def test_effort_limits(model, urdf):
    """As published, but for ankles and waist roll and pitch: 50 N m where the published file states 35."""
    for joint in g1.ALL_JOINTS:
        published = urdf.upperEffortLimit[urdf.joints[urdf.getJointId(joint)].idx_v]
        stem = g1.stem(joint)
        assert published == PUBLISHED_EFFORT[stem]
        ours = RAISED_EFFORT.get(stem, published)
        np.testing.assert_allclose(model.actuator(joint.removesuffix("_joint")).forcerange, [-ours, ours])
    assert {k for k, v in PUBLISHED_EFFORT.items() if v == 35} == set(RAISED_EFFORT)


def test_kinematics_of_the_published_robot(model, urdf):
    """Pose of every body at random configurations, to 1e-6."""
    data, other = mujoco.MjData(model), urdf.createData()
    for q, v in random_states(model, 10, seed=7):
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        pin.forwardKinematics(urdf, other, to_pinocchio(q, v)[0])
        for i, joint in enumerate(urdf.names[1:], start=1):
            body = data.body(body_of(joint))
            np.testing.assert_allclose(body.xpos, other.oMi[i].translation, atol=1e-6, err_msg=joint)
            np.testing.assert_allclose(body.xmat.reshape(3, 3), other.oMi[i].rotation, atol=1e-6, err_msg=joint)


def test_sensor_frames_are_those_of_the_published_robot(model, urdf):
    """Where the inertial sensors sit, from frames of the published file."""
    for site in ("imu_in_pelvis", "imu_in_torso"):
        frame = urdf.frames[urdf.getFrameId(site)]
        assert model.body(int(model.site_bodyid[model.site(site).id])).name == body_of(urdf.names[frame.parentJoint])
        np.testing.assert_allclose(model.site(site).pos, frame.placement.translation, atol=1e-6)


# Three libraries


def mujoco_terms(model, data, q, v):
    """Mass matrix without armature, centre of mass, its velocity; kinematics are left in `data`."""
    data.qpos[:], data.qvel[:] = q, v
    mujoco.mj_forward(model, data)
    mujoco.mj_subtreeVel(model, data)
    mass = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, mass)
    return mass - np.diag(model.dof_armature), data.subtree_com[1].copy(), data.subtree_linvel[1].copy()


def body_velocity(model, data, name):
    """ω and v of the body frame's origin, (6,) in W."""
    out = np.zeros(6)
    mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_XBODY, model.body(name).id, out, 0)
    return out


def check_pinocchio(model, other):
    """Pose and velocity of every body, sites, centre of mass and mass matrix at 20 random states."""
    data, scratch = mujoco.MjData(model), other.createData()
    bodies = [model.body(i).name for i in range(1, model.nbody)]
    for q, v in random_states(model, 20):
        mass, com, com_velocity = mujoco_terms(model, data, q, v)
        q_pin, v_pin = to_pinocchio(q, v)
        pin.forwardKinematics(other, scratch, q_pin, v_pin)
        pin.updateFramePlacements(other, scratch)
        for name in bodies:
            frame = other.getFrameId(name, pin.FrameType.BODY)
            np.testing.assert_allclose(scratch.oMf[frame].translation, data.body(name).xpos, atol=1e-9, err_msg=name)
            np.testing.assert_allclose(scratch.oMf[frame].rotation, data.body(name).xmat.reshape(3, 3), atol=1e-9)
            speed = pin.getFrameVelocity(other, scratch, frame, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
            found = np.concatenate([speed.angular, speed.linear])
            np.testing.assert_allclose(found, body_velocity(model, data, name), atol=1e-9, err_msg=name)
        pin.centerOfMass(other, scratch, q_pin, v_pin)
        np.testing.assert_allclose(scratch.com[0], com, atol=1e-9)
        np.testing.assert_allclose(scratch.vcom[0], com_velocity, atol=1e-9)
        change = base_change(q, "pinocchio")
        half = np.triu(pin.crba(other, scratch, q_pin))
        full = half + half.T - np.diag(np.diag(half)) - np.diag(other.armature)
        np.testing.assert_allclose(change.T @ full @ change, mass, atol=1e-8)


def test_pinocchio_agrees_with_mujoco(model):
    other = builder.pinocchio_model(29)
    assert tuple(other.names)[2:] == g1.ALL_JOINTS
    np.testing.assert_allclose(other.armature[6:], model.dof_armature[6:])
    check_pinocchio(model, other)


@pytest.mark.parametrize("joints", [20, 29])
def test_torque_limits_agree_in_all_simulators(joints):
    from pydrake.multibody.plant import MultibodyPlant

    model, other = builder.build_model(joints=joints, floor=False), builder.pinocchio_model(joints)
    plant = MultibodyPlant(0.0)
    builder.add_to_plant(plant, joints)
    plant.Finalize()
    for i in range(model.nu):
        name = model.joint(int(model.actuator_trnid[i, 0])).name
        low, high = model.actuator_forcerange[i]
        v = other.joints[other.getJointId(name)].idx_v
        assert (other.lowerEffortLimit[v], other.upperEffortLimit[v], other.effortLimit[v]) == (low, high, high)
        assert plant.GetJointActuatorByName(name.removesuffix("_joint")).effort_limit() == high
    knee = other.joints[other.getJointId("left_knee_joint")].idx_v
    assert other.effortLimit[knee] == 139.0


def test_pinocchio_knows_the_sites(model):
    """Keypoints are frames of the Pinocchio model too."""
    other = builder.pinocchio_model(29)
    data, scratch = mujoco.MjData(model), other.createData()
    q, v = next(random_states(model, 1, seed=3))
    data.qpos[:] = q
    mujoco.mj_kinematics(model, data)
    pin.framesForwardKinematics(other, scratch, to_pinocchio(q, v)[0])
    for i in range(model.nsite):
        name = model.site(i).name
        frame = other.getFrameId(name, pin.FrameType.OP_FRAME)
        np.testing.assert_allclose(scratch.oMf[frame].translation, data.site(name).xpos, atol=1e-9, err_msg=name)


def test_reduced_models_agree():
    """20 joints, waist and wrists welded at zero."""
    model, other = builder.build_model(joints=20, floor=False), builder.pinocchio_model(20)
    assert tuple(other.names)[2:] == g1.ACTION_JOINTS
    assert sum(i.mass for i in other.inertias) == pytest.approx(URDF_MASS_KG)
    check_pinocchio(model, other)


def test_drake_agrees_with_mujoco(model):
    """Pose and velocity of every body, centre of mass and mass matrix at 20 random states; limits and armature."""
    plant_module = pytest.importorskip("pydrake.multibody.plant")
    plant = plant_module.MultibodyPlant(0.001)
    (instance,) = builder.add_to_plant(plant)
    plant.Finalize()
    context, data = plant.CreateDefaultContext(), mujoco.MjData(model)
    assert [j.removesuffix("_q").split("_", 1)[1] for j in plant.GetPositionNames()[7:]] == list(g1.ALL_JOINTS)
    actuators = {plant.get_joint_actuator(i) for i in plant.GetJointActuatorIndices()}
    effort = {a.joint().name(): a.effort_limit() for a in actuators}
    assert effort == {j: model.actuator(j.removesuffix("_joint")).forcerange[1] for j in g1.ALL_JOINTS}
    rotor = {a.joint().name(): a.default_rotor_inertia() * a.default_gear_ratio() ** 2 for a in actuators}
    armature = np.concatenate([np.zeros(6), [rotor[j] for j in g1.ALL_JOINTS]])
    np.testing.assert_allclose(armature, model.dof_armature)
    np.testing.assert_allclose(plant.GetPositionLowerLimits()[7:], model.jnt_range[1:, 0])
    np.testing.assert_allclose(plant.GetPositionUpperLimits()[7:], model.jnt_range[1:, 1])
    for q, v in random_states(model, 20):
        mass, com, com_velocity = mujoco_terms(model, data, q, v)
        q_drake, v_drake = to_drake(q, v)
        plant.SetPositions(context, q_drake)
        plant.SetVelocities(context, v_drake)
        for index in plant.GetBodyIndices(instance):
            body = plant.get_body(index)
            X_WB, V_WB = body.EvalPoseInWorld(context), body.EvalSpatialVelocityInWorld(context)
            np.testing.assert_allclose(X_WB.translation(), data.body(body.name()).xpos, atol=1e-9)
            np.testing.assert_allclose(X_WB.rotation().matrix(), data.body(body.name()).xmat.reshape(3, 3), atol=1e-9)
            np.testing.assert_allclose(V_WB.get_coeffs(), body_velocity(model, data, body.name()), atol=1e-9)
        np.testing.assert_allclose(plant.CalcCenterOfMassPositionInWorld(context), com, atol=1e-9)
        np.testing.assert_allclose(plant.CalcCenterOfMassTranslationalVelocityInWorld(context), com_velocity, atol=1e-9)
        change = base_change(q, "drake")
        full = plant.CalcMassMatrix(context) - np.diag(armature)
        np.testing.assert_allclose(change.T @ full @ change, mass, atol=1e-8)


# Names, geometry, symmetry


def test_keypoints_lie_on_their_bodies(model):
    mirror = {k.replace("left_", "right_"): b.replace("left_", "right_") for k, b in KEYPOINT_BODY.items()}
    places = KEYPOINT_BODY | mirror
    used = (*g1.SGF_KEYPOINTS, *g1.STEERED_KEYPOINTS, *g1.OGF_KEYPOINTS, *g1.FOOT_ENDS)
    assert set(used) == set(places)
    assert len(g1.SGF_KEYPOINTS) == 9 and len(g1.OGF_KEYPOINTS) == 2
    for site, body in places.items():
        assert model.body(int(model.site_bodyid[model.site(site).id])).name == body
    data = mujoco.MjData(model)
    data.qpos[:7] = [0, 0, g1.STANDING_HEIGHT_M, 1, 0, 0, 0]
    mujoco.mj_kinematics(model, data)
    height = {s: data.site(s).xpos[2] for s in places}
    assert height["head"] > height["left_shoulder"] > height["torso"] > height["pelvis"] > height["left_knee"] > 0.2
    assert data.site("left_toe").xpos[0] > 0.1 > 0 > data.site("left_heel").xpos[0]
    assert all(data.site(s).xpos[1] > 0.05 for s in places if s.startswith("left_"))


def geoms_of(model, body):
    start = int(model.body(body).geomadr[0])
    return range(start, start + int(model.body(body).geomnum[0]))


FOOT_BOX = ("ankle_roll_link_0", "ankle_roll_link_1")  # a standing foot meets the floor with its soles alone


def test_every_link_has_collision_geometry(model):
    """Every link can meet an obstacle; soles and palms have four spheres each; no geometry adds mass."""
    for i in range(1, model.nbody):
        name = model.body(i).name
        assert any(model.geom_conaffinity[g] & builder.OBSTACLE for g in geoms_of(model, name)), name
    for side in g1.SIDES:
        soles = [model.geom(f"{side}_sole_{i}") for i in range(4)]
        palms = [model.geom(f"{side}_palm_{i}") for i in range(4)]
        assert all(int(g.conaffinity[0]) & builder.FLOOR for g in soles)
        assert all(int(g.conaffinity[0]) & builder.OBJECT for g in palms)
    off = {model.geom(g).name for g in range(model.ngeom) if not model.geom_conaffinity[g] & builder.FLOOR}
    feet = {f"{side}_{part}" for side in g1.SIDES for part in ("ankle_pitch_link_0", *FOOT_BOX)}
    assert off == feet | {f"{side}_palm_{i}" for side in g1.SIDES for i in range(4)}


def distance_to_link(model, body, p_B):
    """Signed distance to the union of the body's primitives, (N, 3) in the body frame [m] -> (N,) [m]."""
    best = np.full(len(p_B), np.inf)
    for g in geoms_of(model, body):
        p, size = (p_B - model.geom_pos[g]) @ quat_to_mat(model.geom_quat[g]), model.geom_size[g]
        if model.geom_type[g] == mujoco.mjtGeom.mjGEOM_BOX:
            out = np.abs(p) - size
            distance = np.linalg.norm(np.maximum(out, 0), axis=1) + np.minimum(out.max(axis=1), 0)
        else:  # capsule, or sphere: a capsule of no length
            half = size[1] if model.geom_type[g] == mujoco.mjtGeom.mjGEOM_CAPSULE else 0.0
            p = p - np.clip(p[:, 2:], -half, half) * [0, 0, 1]
            distance = np.linalg.norm(p, axis=1) - size[0]
        best = np.minimum(best, distance)
    return best


def test_primitives_cover_the_published_shells(model, urdf, urdf_path):
    """Every vertex of every shell lies within COVER_M of its own link's primitives; 99 % of each within 1.5 cm."""
    trimesh = pytest.importorskip("trimesh")
    worst, covered = {}, set()
    for kind in (pin.GeometryType.VISUAL, pin.GeometryType.COLLISION):
        for item in pin.buildGeomFromUrdf(urdf, str(urdf_path), kind, package_dirs=[str(prefix())]).geometryObjects:
            key = (body_of(urdf.names[item.parentJoint]), Path(item.meshPath).name)
            if key in worst or not item.meshPath.lower().endswith(".stl"):
                continue
            mesh = trimesh.load_mesh(item.meshPath)
            mesh.apply_transform(item.placement.homogeneous)
            distance = distance_to_link(model, key[0], np.asarray(mesh.vertices))
            worst[key] = distance.max()
            covered.add(key[0])
            assert np.quantile(distance, 0.99) < 0.015, key
    assert covered == {model.body(i).name for i in range(1, model.nbody)}
    assert max(worst.values()) < COVER_M, max(worst.items(), key=lambda item: item[1])


def test_height_of_the_standing_robot(model):
    """1.32 m from sole to top of the head with straight legs, 0.35 to 0.45 m wide at the shoulders."""
    data = mujoco.MjData(model)
    data.qpos[:7] = [0, 0, g1.STANDING_HEIGHT_M, 1, 0, 0, 0]
    mujoco.mj_kinematics(model, data)
    rng = np.random.default_rng(0)
    points = []
    for g in range(model.ngeom):
        size, kind = model.geom_size[g], model.geom_type[g]
        u = normalize(rng.normal(size=(3000, 3)))
        if kind == mujoco.mjtGeom.mjGEOM_BOX:
            p = np.sign(u) * size
        else:
            half = size[1] if kind == mujoco.mjtGeom.mjGEOM_CAPSULE else 0.0
            p = u * size[0] + np.sign(u[:, 2:]) * [0, 0, half]
        points.append(data.geom_xpos[g] + p @ data.geom_xmat[g].reshape(3, 3).T)
    cloud = np.concatenate(points)
    assert cloud[:, 2].max() == pytest.approx(1.32, abs=0.01) and cloud[:, 2].min() == pytest.approx(0.0, abs=0.003)
    upper = cloud[(cloud[:, 2] > 1.0) & (cloud[:, 2] < 1.15)]
    assert 0.35 < np.ptp(upper[:, 1]) < 0.45


@pytest.mark.parametrize("joints", [20, 29])
def test_mirrored_angles_give_mirrored_keypoints(joints):
    """Sagittal symmetry of joints, gains, limits and sites; the published frames differ by up to 0.02 mm."""
    model = builder.build_model(joints=joints, floor=False)
    names = g1.ALL_JOINTS if joints == 29 else g1.ACTION_JOINTS
    index, sign = g1.mirror_joints(names)
    np.testing.assert_array_equal(index[index], np.arange(joints))
    limits = model.jnt_range[1:]
    flipped = np.sort(sign[:, None] * limits[index], axis=1)
    np.testing.assert_allclose(flipped, limits, atol=1e-9)
    kp, kd = g1.gains(names)
    np.testing.assert_array_equal(kp[index], kp)
    np.testing.assert_array_equal(kd[index], kd)
    a, b = mujoco.MjData(model), mujoco.MjData(model)
    swap = {"left": "right", "right": "left"}

    def other(name):
        side = name.split("_", 1)[0]
        return name.replace(side, swap[side], 1) if side in swap else name

    for q, _ in random_states(model, 5, seed=11):
        a.qpos[:] = [0, 0, 0, 1, 0, 0, 0, *q[7:]]
        b.qpos[:] = [0, 0, 0, 1, 0, 0, 0, *(sign * q[7:][index])]
        mujoco.mj_kinematics(model, a)
        mujoco.mj_kinematics(model, b)
        for i in range(model.nsite):
            name = model.site(i).name
            if not name.startswith("imu"):
                expected = a.site(name).xpos * [1, -1, 1]
                np.testing.assert_allclose(b.site(other(name)).xpos, expected, atol=5e-5, err_msg=name)


def test_shells_are_mirrored(model):
    """The right side's primitives are the left side's, mirrored in y."""
    for i in range(model.ngeom):
        name = model.geom(i).name
        if name.startswith("left_"):
            right = model.geom(name.replace("left", "right", 1))
            np.testing.assert_allclose(right.pos, model.geom_pos[i] * [1, -1, 1], atol=1e-9)
            np.testing.assert_allclose(right.size, model.geom_size[i])


def test_gains_name_what_exists():
    kp, kd = g1.gains()
    assert kp.shape == kd.shape == (20,) and (kp > 0).all() and (kd > 0).all()
    with pytest.raises(UnknownName, match=re.escape("unknown joint 'left_tail_joint'")):
        g1.gains(["left_tail_joint"])


def test_the_description_is_what_its_tool_writes(tmp_path, monkeypatch):
    """`tools/derive_g1.py` reproduces g1.xml."""
    prefix()
    monkeypatch.syspath_prepend(str(Path(__file__).parents[2] / "tools"))
    derive_g1 = pytest.importorskip("derive_g1")
    monkeypatch.setattr(derive_g1, "OUT", tmp_path / "g1.xml")
    derive_g1.main()
    assert (tmp_path / "g1.xml").read_text() == Path(g1.xml_path()).read_text()


def test_training_needs_neither_pinocchio_nor_drake():
    code = (
        "import sys, hotice.model.builder, hotice.model.carry; "
        "print([m for m in ('pinocchio', 'pydrake', 'torch') if m in sys.modules])"
    )
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert out.stdout.strip() == "[]"


def test_parts_of_a_configuration_are_where_the_simulators_have_them():
    """Every element of qpos and qvel by its joint: the names of `g1` cut the same."""
    model = builder.build_model(Box((0.3, 0.3, 0.3), 1.0))
    root, held = model.body(g1.ROOT_BODY), model.body(builder.OBJECT_BODY)
    parts = [(root, (g1.ROOT_POS, g1.ROOT_QUAT), (g1.ROOT_VEL, g1.ROOT_RATE))]
    parts.append((held, (g1.OBJECT_POS, g1.OBJECT_QUAT), (g1.OBJECT_VEL, g1.OBJECT_RATE)))
    for body, q, v in parts:
        start, dof = model.jnt_qposadr[body.jntadr[0]], model.jnt_dofadr[body.jntadr[0]]
        assert q == (slice(start, start + 3), slice(start + 3, start + 7))
        assert v == (slice(dof, dof + 3), slice(dof + 3, dof + 6))
    places = range(model.nq)[g1.JOINT_POS], range(model.nv)[g1.JOINT_VEL]
    robot = builder.pinocchio_model(20)
    for joint, q, v in zip(g1.ACTION_JOINTS, *places, strict=True):
        assert (model.joint(joint).qposadr[0], model.joint(joint).dofadr[0]) == (q, v)
        assert (robot.joints[robot.getJointId(joint)].idx_q, robot.joints[robot.getJointId(joint)].idx_v) == (q, v)
    assert model.nq == g1.OBJECT_QUAT.stop and model.nv == g1.OBJECT_RATE.stop and g1.ACTIONS == model.nu
    assert model.opt.gravity.tolist() == [0.0, 0.0, -GRAVITY] and robot.gravity.linear.tolist() == [0.0, 0.0, -GRAVITY]
