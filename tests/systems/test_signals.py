"""Adaptors and the servo: each system gives what its plain function gives."""

import mujoco
import numpy as np
from pydrake.multibody.plant import MultibodyPlant

from hotice.model import builder, g1
from hotice.model.joint_limits import torque_limits
from hotice.model.robot_state import RobotState
from hotice.systems.drake_plant import DrakePlant
from hotice.systems.joint_pd import JointPd, pd_torque
from hotice.systems.signals import JOINT_POS, JOINT_VEL
from hotice.systems.state_adaptor import (
    DrakeStateAdaptor,
    MujocoStateAdaptor,
    drake_to_robot_state,
    robot_state_of_mujoco,
)


def test_mujoco_state(carry, rng, run):
    qpos, qvel = carry.qpos() + 0.01 * rng.standard_normal(34), rng.standard_normal(32)
    for quat in (slice(3, 7), slice(30, 34)):
        qpos[quat] /= np.linalg.norm(qpos[quat])
    wanted = RobotState.from_mujoco(qpos, qvel, carried=carry.carried, wrist_pos=carry.wrist_pos).to_mujoco(29)
    state = robot_state_of_mujoco(np.concatenate([qpos, qvel]), carry.wrist_pos)
    np.testing.assert_allclose(state, np.concatenate(wanted), atol=1e-15)
    full = np.concatenate([[7.0], qpos, qvel, rng.standard_normal(50)])
    adaptor = MujocoStateAdaptor(len(full), 1, carry.wrist_pos)
    np.testing.assert_array_equal(run(adaptor, "robot_state", full_state=full), state)
    joints = run(adaptor, "joint_state", full_state=full)
    np.testing.assert_array_equal(joints, np.concatenate([qpos[7:27], qvel[6:26]]))
    np.testing.assert_array_equal(state[np.append(JOINT_POS, JOINT_VEL)], joints)


def test_drake_state(carry, beam, rng, run):
    """Against Drake's own kinematics: body poses and body-fixed angular velocities."""
    drake = DrakePlant(beam, carry.carried, carry.wrist_pos, carry.qpos(), 0.002, True)
    plant: MultibodyPlant = drake.plant
    x = np.zeros(plant.num_positions() + plant.num_velocities())
    x[drake.index] = rng.standard_normal(66)
    x[drake.index[:4]] = 0.5, -0.5, 0.5, 0.5
    x[drake.index[27:31]] = 0.8, 0.0, 0.6, 0.0
    context = plant.CreateDefaultContext()
    plant.SetPositionsAndVelocities(context, x)
    state = drake_to_robot_state(drake.index, carry.wrist_pos)(x)
    adaptor = DrakeStateAdaptor(len(x), drake.index, carry.wrist_pos)
    np.testing.assert_array_equal(run(adaptor, "robot_state", state=x), state)
    np.testing.assert_array_equal(run(adaptor, "joint_state", state=x), state[np.append(JOINT_POS, JOINT_VEL)])
    for name, q, v in (("pelvis", 0, 0), ("object", 36, 35)):
        body = plant.GetBodyByName(name)
        X_WB, V_WB = body.EvalPoseInWorld(context), body.EvalSpatialVelocityInWorld(context)
        np.testing.assert_allclose(state[q : q + 3], X_WB.translation(), atol=1e-12)
        np.testing.assert_allclose(
            np.abs(state[q + 3 : q + 7]), np.abs(X_WB.rotation().ToQuaternion().wxyz()), atol=1e-12
        )
        np.testing.assert_allclose(state[43 + v : 46 + v], V_WB.translational(), atol=1e-12)
        w_B = X_WB.rotation().matrix().T @ V_WB.rotational()
        np.testing.assert_allclose(state[46 + v : 49 + v], w_B, atol=1e-12)
    for joint, angle in zip(g1.ACTION_JOINTS, state[JOINT_POS], strict=True):
        assert plant.GetJointByName(joint).get_angle(context) == angle


def test_servo(carry, rng, run):
    kp, kd = g1.gains()
    limit = torque_limits(g1.ACTION_JOINTS)
    for scale in (0.1, 3.0):
        q, qd = carry.joint_pos + scale * rng.standard_normal(20), scale * rng.standard_normal(20)
        torque = run(JointPd(), "torque", joint_target=carry.joint_target, joint_state=np.append(q, qd))
        np.testing.assert_array_equal(torque, pd_torque(carry.joint_target, q, qd, kp, kd, limit))
    assert (np.abs(torque) == limit).any()
    assert np.isnan(run(JointPd(), "torque", joint_target=np.full(20, np.nan), joint_state=np.zeros(40))).all()


def test_servo_is_the_motors_own(carry, rng):
    model = builder.build_model(carry.carried, wrist_pos=carry.wrist_pos)
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = carry.qpos(), 0.3 * rng.standard_normal(32)
    data.ctrl[:] = carry.joint_target + 0.2 * rng.standard_normal(20)
    mujoco.mj_forward(model, data)
    torque = pd_torque(data.ctrl, data.qpos[7:27], data.qvel[6:26], *g1.gains(), torque_limits(g1.ACTION_JOINTS))
    np.testing.assert_allclose(torque, data.actuator_force, atol=1e-10)


def test_twenty_joints_of_the_plant_are_welded_like_mujocos(carry):
    """Kinematics of the robot with welded wrists, in both simulators."""
    plant = MultibodyPlant(0.0)
    builder.add_to_plant(plant, 20, carry.wrist_pos)
    plant.Finalize()
    model = builder.build_model(None, wrist_pos=carry.wrist_pos, floor=False)
    data = mujoco.MjData(model)
    data.qpos[:] = carry.qpos()[:27]
    mujoco.mj_kinematics(model, data)
    context = plant.CreateDefaultContext()
    q = np.concatenate([data.qpos[3:7], data.qpos[:3], data.qpos[7:]])
    assert plant.num_positions() == 27
    plant.SetPositions(context, q)
    for name in ("left_wrist_yaw_link", "right_wrist_yaw_link", "left_ankle_roll_link", "torso_link"):
        pose = plant.GetBodyByName(name).EvalPoseInWorld(context)
        np.testing.assert_allclose(pose.translation(), data.body(name).xpos, atol=1e-9)
        np.testing.assert_allclose(pose.rotation().matrix().ravel(), data.body(name).xmat, atol=1e-9)
