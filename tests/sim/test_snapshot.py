"""Snapshots against plain MuJoCo of the same state."""

import mujoco
import numpy as np
import pytest
import torch

from hotice.fields.bank import FieldBank
from hotice.model import g1, load_scenes
from hotice.sim.snapshot import LOOK_AHEAD_S, POINTS


def plain(env, i):
    model = env.carry.models[int(env.memory.model[i])]
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = env.physics.qpos[i].numpy(), env.physics.qvel[i].numpy()
    mujoco.mj_forward(model, data)
    return model, data


def site_velocity(model, data, name):
    out = np.zeros(6)
    mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_SITE, model.site(name).id, out, 0)
    return out[3:]


def test_points_and_their_velocities(moving):
    s = moving.snapshot()
    assert s.v_WK.abs().max() > 0.1
    for i in range(moving.num_envs):
        model, data = plain(moving, i)
        for k, name in enumerate(POINTS):
            np.testing.assert_allclose(s.p_WK[i, k], data.site(name).xpos, atol=1e-6, err_msg=name)
            np.testing.assert_allclose(s.v_WK[i, k], site_velocity(model, data, name), atol=2e-6, err_msg=name)


def test_velocities_are_the_differences_of_positions(moving):
    """Also of the object's keypoints: those of a sphere keep world directions, the others turn with it."""
    s, h = moving.snapshot(), 1e-6
    for i in range(4):
        model, data = plain(moving, i)
        before = data.qpos.copy()
        points = []
        for sign in (-1, 1):
            data.qpos[:] = before
            mujoco.mj_integratePos(model, data.qpos, data.qvel, sign * h)
            mujoco.mj_kinematics(model, data)
            R, p = data.body("object").xmat.reshape(3, 3), data.body("object").xpos
            local = moving.carry.states[i].carried.keypoints()
            sphere = moving.carry.states[i].carried.shape == "sphere"
            points.append(
                np.concatenate([[data.site(n).xpos.copy() for n in POINTS], p + (local if sphere else local @ R.T)])
            )
        velocity = (points[1] - points[0]) / (2 * h)
        np.testing.assert_allclose(torch.cat([s.v_WK[i], s.v_WOK[i]]), velocity, atol=2e-5)
        np.testing.assert_allclose(s.p_WOK[i], 0.5 * (points[0] + points[1])[len(POINTS) :], atol=1e-6)


def test_root_object_joints_and_torques(moving):
    s = moving.snapshot()
    for i in range(moving.num_envs):
        model, data = plain(moving, i)
        R_WP = data.body("pelvis").xmat.reshape(3, 3)
        np.testing.assert_allclose(s.p_WP[i], data.body("pelvis").xpos, atol=1e-6)
        np.testing.assert_allclose(s.R_WP[i], R_WP, atol=1e-6)
        np.testing.assert_allclose(s.gravity_P[i], R_WP.T @ [0, 0, -1.0], atol=1e-6)
        for body, linear, spin in (("pelvis", s.v_WP, s.w_WP_P), ("object", s.v_WO, s.w_WO)):
            out = np.zeros(6)
            which = model.body(body).id
            mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_XBODY, which, out, body == "pelvis")
            np.testing.assert_allclose(spin[i], out[:3], atol=1e-5, err_msg=body)
            mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_XBODY, which, out, 0)
            np.testing.assert_allclose(linear[i], out[3:], atol=1e-5, err_msg=body)
        for j, name in enumerate(g1.ACTION_JOINTS):
            assert float(s.q[i, j]) == pytest.approx(data.joint(name).qpos[0], abs=1e-6)
            assert float(s.qd[i, j]) == pytest.approx(data.joint(name).qvel[0], abs=1e-5)
    assert torch.equal(s.torque, moving.physics.actuator_force.float()) and s.torque.abs().max() > 5


def test_yaw_frame_keeps_z_and_turns_with_the_heading_only(moving):
    s = moving.snapshot()
    heading = torch.stack([torch.cos(s.yaw), torch.sin(s.yaw), torch.full_like(s.yaw, 0.3)], dim=1)
    expected = torch.tensor([1.0, 0.0, 0.3]).expand(8, 3)
    torch.testing.assert_close(s.to_yaw_frame(heading), expected, atol=1e-6, rtol=0)
    torch.testing.assert_close(s.to_yaw_frame(heading[:, None].expand(8, 4, 3)), expected[:, None].expand(8, 4, 3))
    forward = s.R_WP[:, :, 0]
    assert (s.to_yaw_frame(forward)[:, 1].abs() < 1e-6).all()
    goal_W = moving.bank.goal_W[moving.memory.scene] - s.p_WP
    torch.testing.assert_close(s.to_yaw_frame(goal_W)[:, :2], s.goal_Y, atol=1e-5, rtol=0)
    torch.testing.assert_close(s.goal_distance, s.goal_Y.norm(dim=1))


def test_a_part_of_the_environments_reads_the_same(moving):
    ids = torch.tensor([6, 1])
    whole, part = moving.snapshot(), moving.snapshot(ids)
    for name, value in vars(part).items():
        if isinstance(value, torch.Tensor):
            assert torch.equal(value, getattr(whole, name)[ids]), name
    for a, b in zip(part.sgf + part.ogf, whole.sgf + whole.ogf, strict=True):
        assert torch.equal(a, b[ids])


def test_fields_are_sampled_at_the_right_points(moving):
    s, bank, scene = moving.snapshot(), moving.bank, moving.memory.scene
    for k, name in enumerate(g1.SGF_KEYPOINTS):
        assert torch.equal(s.sgf.force_W[:, k], bank.sample("sgf", scene, s.p_WK[:, k : k + 1]).force_W[:, 0]), name
    hands = torch.stack([s.p_WK[:, POINTS.index(h)] for h in ("left_hand", "right_hand")], dim=1)
    expected = bank.sample("ogf", scene, torch.cat([hands, s.p_WOK], dim=1))
    assert torch.equal(s.ogf.force_W, expected.force_W)


def test_the_sgf_presets_read_the_standard_field_everywhere(make_env):
    env = make_env(2, "dual_sgf")
    env.reset()
    s = env.snapshot()
    points = torch.cat([s.p_WK[:, 9:11], s.p_WOK], dim=1)
    assert torch.equal(s.ogf.signed_distance, env.bank.sample("sgf", env.memory.scene, points).signed_distance)


def test_feet_touch_the_floor_at_the_start_and_not_when_lifted(env):
    for _ in range(25):
        env.step(torch.zeros(8, 20))
    assert env.snapshot().touch.all()
    env.physics.qpos[:, 2] += 0.1
    env.physics.forward(torch.arange(8))
    assert not env.snapshot().touch.any()


def test_step_clock_alternates(env):
    """Phase 90 degrees: the left foot is at the top of its swing, the right one stands."""
    env.memory.phase[:] = torch.pi / 2
    s = env.snapshot()
    assert s.stance.tolist() == [[False, True]] * 8
    torch.testing.assert_close(s.swing[:, 0], torch.full((8,), env.config.swing_height_m))
    assert (s.swing[:, 1] == 0).all()


def test_a_push_is_in_every_velocity_of_the_same_snapshot(make_env):
    env = make_env(2, push_m_s=3.0, push_interval_s=0.02)
    env.reset()
    env.step(torch.zeros(2, 20))
    s = env.snapshot()
    assert (s.v_WP[:, :2].norm(dim=1) > 0.05).all()
    torch.testing.assert_close(s.v_WK[:, POINTS.index("pelvis")], s.v_WP, atol=1e-5, rtol=0)


def test_what_lies_ahead_is_met_by_upper_body_and_object_moved_on_with_the_command(make_env):
    bank = FieldBank.build(load_scenes(["gap", "beam"]))
    env = make_env(4, bank=bank)
    env.reset()
    env.memory.scene[:] = torch.tensor([0, 0, 1, 1])
    s = env.snapshot()
    assert (s.c_W[:, :2].norm(dim=1) > 0.3).all()
    scene, model = env.memory.scene, env.memory.model
    xpos, xmat = env.physics.xpos.float(), env.physics.xmat.float().view(4, -1, 3, 3)
    xpos = xpos + LOOK_AHEAD_S * (s.c_W * torch.tensor([1.0, 1.0, 0.0]))[:, None]

    def gap(cover, variant):
        centre = xpos[:, cover.frame] + (xmat[:, cover.frame] @ cover.centre[variant][..., None]).squeeze(-1)
        return (bank.signed_distance(scene, centre) - cover.radius[variant]).amin(dim=1)

    want = torch.minimum(gap(env.reader.upper_cover, torch.zeros_like(model)), gap(env.reader.object_cover, model))
    torch.testing.assert_close(s.clearance_ahead, want, atol=1e-5, rtol=0)
    assert (s.clearance_ahead < s.clearance).all()


def test_feet_are_no_part_of_what_lies_ahead(env):
    model = env.carry.models[0]
    names = {model.body(int(b)).name for b in env.reader.upper_cover.frame}
    assert {"pelvis", "torso_link", "left_elbow_link"} <= names
    assert not {n for n in names if "knee" in n or "ankle" in n or "hip" in n}
