from dataclasses import replace

import mujoco
import numpy as np
import pytest
import torch

from hotice.errors import InvalidConfig
from hotice.model.dynamics import DynamicsConfig
from hotice.sim import TaskConfig
from hotice.sim.carry_bank import CarryBank
from hotice.sim.snapshot import FEET, POINTS
from hotice.task.sensing import STUDENT_SENSING, SensingConfig


def noisy(make_env, num_envs=64, **sensing):
    env = make_env(num_envs, sensing=SensingConfig(**sensing))
    env.reset()
    return env


def row(env, observation, name):
    start = 0
    for title, size in env.policy_table.layout():
        if title == name:
            return observation[:, start : start + size]
        start += size
    raise KeyError(name)


def measure(env, s):
    return env.sensors.measure(s, env.everyone, torch.zeros(env.num_envs, 20), env.generator)


def test_exact_sensing_reads_the_truth(make_env):
    env = make_env(8)
    observation, _ = env.reset()
    torch.testing.assert_close(observation, env.policy_table(env.snapshot()), rtol=0, atol=0)


@pytest.mark.parametrize(
    "config, attribute, half",
    [
        ({"joint_pos_rad": 0.03}, "q", 0.03),
        ({"joint_vel_rad_s": 1.5}, "qd", 1.5),
        ({"gravity": 0.05}, "gravity_P", 0.05),
        ({"gyro_rad_s": 0.2}, "w_WP_P", 0.2),
        ({"object_pos_m": 0.05}, "p_WO", 0.05),
        ({"root_pos_m": 0.02}, "p_WP", 0.02),
        ({"root_yaw_rad": 0.03}, "yaw", 0.03),
    ],
)
def test_noise_is_uniform_of_the_given_half_width(make_env, config, attribute, half):
    env = noisy(make_env, 256, **config)
    s = env.snapshot()
    error = getattr(measure(env, s), attribute) - getattr(s, attribute)
    assert error.abs().max() <= half * 1.0001
    assert error.std() == pytest.approx(half / 3**0.5, rel=0.15)
    assert abs(float(error.mean())) < 0.15 * half


def test_the_object_has_one_estimate_for_pose_and_field(make_env):
    env = noisy(make_env, object_pos_m=0.05, object_rot_rad=0.087)
    s = env.snapshot()
    m = measure(env, s)
    corners_O = (s.p_WOK - s.p_WO[:, None]) @ s.R_WO
    boxes = ~s.grasp.world_aligned
    expected = m.p_WO[:, None] + corners_O @ m.R_WO.transpose(1, 2)
    torch.testing.assert_close(m.p_WOK[boxes], expected[boxes], atol=1e-5, rtol=0)
    points = torch.cat([m.p_WK[:, 9:11], m.p_WOK], dim=1)
    torch.testing.assert_close(m.ogf.force_W, env.bank.sample("ogf", env.memory.scene, points).force_W)
    torch.testing.assert_close(m.p_WK, s.p_WK)


def test_the_filter_averages_the_object_pose_and_forgets(make_env):
    half, tilt = 0.05, 0.087
    env = noisy(make_env, 128, object_pos_m=half, object_rot_rad=tilt, object_filter_s=0.2)
    s = env.snapshot()
    for _ in range(60):
        m = measure(env, s)
    error = m.p_WO - s.p_WO
    gain = env.config.control_dt_s / 0.2
    settled = half / 3**0.5 * (gain / (2 - gain)) ** 0.5
    assert error.std() == pytest.approx(settled, rel=0.2)
    turn = m.R_WO @ s.R_WO.transpose(1, 2)
    torch.testing.assert_close(turn @ turn.transpose(1, 2), torch.eye(3).expand(128, 3, 3), atol=1e-5, rtol=0)
    assert (turn - torch.eye(3)).abs().max() < tilt
    moved = replace(s, p_WO=s.p_WO + torch.tensor([0.0, 0.0, 1.0]))
    for _ in range(10):
        m = measure(env, moved)
    assert (m.p_WO - s.p_WO)[:, 2].mean() == pytest.approx(1 - (1 - gain) ** 10, abs=0.02)


def test_the_filter_takes_no_part_in_a_turn_of_the_robot(make_env):
    env = noisy(make_env, 16, object_filter_s=0.5)
    s = env.snapshot()
    measure(env, s)
    cos, sin = torch.cos(torch.tensor(1.0)), torch.sin(torch.tensor(1.0))
    R = torch.tensor([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    turned = replace(s, p_WO=s.p_WP + (s.p_WO - s.p_WP) @ R.T, R_WO=R @ s.R_WO, R_WP=R @ s.R_WP, yaw=s.yaw + 1.0)
    m = measure(env, turned)
    torch.testing.assert_close(m.p_WO, turned.p_WO, atol=1e-5, rtol=0)
    torch.testing.assert_close(m.R_WO, turned.R_WO, atol=1e-5, rtol=0)


def test_a_wrong_heading_turns_all_that_is_seen_about_the_root(make_env):
    env = noisy(make_env, root_yaw_rad=0.3)
    s = env.snapshot()
    m = measure(env, s)
    torch.testing.assert_close(m.to_yaw_frame(m.p_WO - m.p_WP), s.to_yaw_frame(s.p_WO - s.p_WP), atol=1e-5, rtol=0)
    torch.testing.assert_close(
        m.to_yaw_frame(m.p_WK[:, 3] - m.p_WP), s.to_yaw_frame(s.p_WK[:, 3] - s.p_WP), atol=1e-5, rtol=0
    )
    torch.testing.assert_close(m.gravity_P, s.gravity_P)
    turned = (m.yaw - s.yaw).abs().max()
    assert 0.2 < turned <= 0.3001


def test_the_root_pose_is_refreshed_at_its_rate(make_env):
    env = noisy(make_env, 4, root_hz=10.0)
    places = []
    for _ in range(11):
        env.step(torch.zeros(4, 20))
        places.append(env.sensors.root.clone())
    changed = [bool((a != b).any()) for a, b in zip(places, places[1:], strict=False)]
    assert changed == [False, False, False, True, False, False, False, False, True, False]


def test_a_tracked_root_keeps_up_with_a_walking_and_turning_robot(make_env):
    """A held root is behind by 7 cm and 0.05 rad at the end of each tenth of a second."""
    behind = {}
    for tracking in (True, False):
        env = noisy(make_env, 4, root_hz=10.0, root_tracking=tracking)
        s = env.snapshot()
        env.sensors.age[:] = 0
        error, turned = [], []
        for k in range(60):
            walked = torch.tensor([0.7, -0.2, 0.0]) * 0.02 * k
            yaw = s.yaw + 0.5 * 0.02 * k
            spin = torch.zeros_like(s.w_WP_P)
            spin[:] = -0.5 * s.gravity_P
            m = measure(env, replace(s, p_WP=s.p_WP + walked, yaw=yaw, w_WP_P=spin))
            error.append(float((m.p_WP - s.p_WP - walked).norm(dim=1).max()))
            turned.append(float((m.yaw - yaw).abs().max()))
        behind[tracking] = max(error[30:]), max(turned[30:])
    assert behind[True][0] < 0.003 and behind[True][1] < 1e-4
    assert 0.05 < behind[False][0] < 0.08 and 0.03 < behind[False][1] < 0.06


def test_late_measurements_come_one_step_later_but_actions_are_known(make_env):
    env = noisy(make_env, 32, sensor_delay_steps=1)
    late = env.sensors.late
    assert 0 < int(late.sum()) < 32
    seen = []
    for t in range(4):
        step = env.step(torch.full((32, 20), 0.1 * t))
        seen.append((step.policy, env.policy_table(env.snapshot())))
    (_, before), (given, now) = seen[-2:]
    torch.testing.assert_close(row(env, given, "joint_pos")[late], row(env, before, "joint_pos")[late])
    torch.testing.assert_close(row(env, given, "joint_pos")[~late], row(env, now, "joint_pos")[~late])
    torch.testing.assert_close(row(env, given, "last_action"), row(env, now, "last_action"))


def test_a_late_action_reaches_the_motors_part_way(make_env):
    env = noisy(make_env, 5, action_delay_s=0.02)
    env.sensors.action_delay[:] = torch.arange(5)
    held = env.held.clone()
    applied = [[] for _ in range(5)]
    step = env.physics._step

    def watched(substeps, ids, *stage):
        for i in range(5) if ids is None else ids.tolist():
            applied[i] += [env.physics.ctrl[i].clone()] * substeps
        step(substeps, ids, *stage)

    env.physics._step = watched
    env.step(torch.ones(5, 20))
    target = env.held.double()
    assert (target != held).all()
    for i, rows in enumerate(applied):
        assert len(rows) == 4
        for k, ctrl in enumerate(rows):
            torch.testing.assert_close(ctrl, target[i] if k >= i else held[i].double())


def test_rewards_and_critic_read_the_truth(make_env):
    exact, rough = make_env(8), make_env(8, sensing=STUDENT_SENSING)
    for env in (exact, rough):
        env.reset()
    rough.physics.load_state(exact.physics.state())
    rough.memory.scene[:], rough.memory.phase[:] = exact.memory.scene, exact.memory.phase
    torch.testing.assert_close(rough.critic_table(rough.snapshot()), exact.critic_table(exact.snapshot()))
    torch.testing.assert_close(rough.rewards(rough.snapshot())[0], exact.rewards(exact.snapshot())[0])


def test_a_perturbed_task_goes_on_bit_for_bit(make_env):
    config = TaskConfig().perturbed()
    spread = {"sensing": config.sensing, "push_m_s": config.push_m_s}
    first, second = make_env(8, **spread), make_env(8, seed=9, **spread)
    generator = torch.Generator().manual_seed(0)
    actions = 0.3 * torch.randn(12, 8, 20, generator=generator)
    first.reset(), second.reset()
    for action in actions[:6]:
        observation = first.step(action).policy
    restored, _ = second.load_state(first.state())
    assert torch.equal(restored, observation)
    for action in actions[6:]:
        a, b = first.step(action), second.step(action)
        assert torch.equal(a.policy, b.policy) and torch.equal(a.reward, b.reward)


def test_keypoints_follow_from_measured_joints(make_env):
    """MuJoCo's kinematics of the measured joints gives the points whose fields the actor reads."""
    env = noisy(make_env, 4, joint_pos_rad=0.03)
    for _ in range(5):
        env.step(0.3 * torch.ones(4, 20))
    s, offset = env.snapshot(), 0.05 * torch.arange(20) / 20
    m = env.sensors.measure(s, env.everyone, offset.expand(4, 20), env.generator)
    assert (m.q - s.q - offset).abs().max() <= 0.03 * 1.0001
    for i in range(4):
        model = env.carry.models[int(env.memory.model[i])]
        data = mujoco.MjData(model)
        data.qpos[:] = env.physics.qpos[i].numpy()
        data.qpos[env.layout.q.numpy()] = m.q[i].numpy()
        mujoco.mj_kinematics(model, data)
        sites = np.stack([data.site(name).xpos for name in POINTS])
        np.testing.assert_allclose(m.p_WK[i], sites, atol=2e-6)
    moved = (m.p_WK - s.p_WK).norm(dim=2)
    assert moved[:, [0, 3, 4]].max() < 1e-6 and moved[:, FEET].min() > 0.001, "the trunk has no joint that is measured"
    torch.testing.assert_close(m.sgf.force_W, env.bank.sample("sgf", env.memory.scene, m.p_WK[:, :9]).force_W)


def test_a_tilt_that_is_off_turns_all_that_is_seen_about_the_root(make_env):
    env = noisy(make_env, 128, gravity=0.05, gyro_rad_s=0.2)
    s = env.snapshot()
    errors = []
    for _ in range(60):
        m = measure(env, s)
        down = env.sensors.gravity
        errors.append(torch.acos((down * s.gravity_P).sum(dim=1).clamp(-1.0, 1.0)).pow(2).mean().sqrt())
    assert errors[0] > 2 * errors[-1] > 0.01 and errors[-1] < 0.02  # settles; not exact
    torch.testing.assert_close(-m.R_WP[:, 2], down, atol=1e-5, rtol=0)
    torch.testing.assert_close(m.R_WP @ m.R_WP.transpose(1, 2), torch.eye(3).expand(128, 3, 3), atol=1e-5, rtol=0)
    torch.testing.assert_close(torch.atan2(m.R_WP[:, 1, 0], m.R_WP[:, 0, 0]), s.yaw, atol=1e-5, rtol=0)
    for seen, true in ((m.p_WK, s.p_WK), (m.p_WOK[~s.grasp.world_aligned], s.p_WOK[~s.grasp.world_aligned])):
        boxes = slice(None) if len(seen) == 128 else ~s.grasp.world_aligned
        seen_P = (seen - m.p_WP[boxes][:, None]) @ m.R_WP[boxes]
        true_P = (true - s.p_WP[boxes][:, None]) @ s.R_WP[boxes]
        torch.testing.assert_close(seen_P, true_P, atol=1e-5, rtol=0)


def test_the_gyro_carries_the_tilt_of_a_rocking_robot(make_env):
    env = noisy(make_env, 4, gravity=1e-6, gyro_rad_s=1e-6)
    s = env.snapshot()
    axis = torch.tensor([0.0, 1.0, 0.0]).expand(4, 3)
    worst, env.sensors.age[:] = 0.0, 0
    for k in range(60):
        angle = torch.tensor(0.3 * np.sin(0.1 * k), dtype=torch.float32)
        cos, sin = torch.cos(angle), torch.sin(angle)
        down = torch.stack([sin, torch.zeros(()), -cos]).expand(4, 3)
        rate = 0.03 * np.cos(0.1 * (k - 0.5)) / 0.02  # of the step that led here
        measure(env, replace(s, gravity_P=down, w_WP_P=axis * rate))
        worst = max(worst, float((env.sensors.gravity - down).abs().max()))
    assert worst < 0.01


def test_critics_and_teachers_read_a_history_without_noise(make_env):
    task = TaskConfig().perturbed()
    env = make_env(8, sensing=task.sensing, history=2)
    env.reset()
    steps = [env.step(0.1 * torch.ones(8, 20)) for _ in range(3)]
    size = env.policy_table.size
    frames = [step.critic[:, :size][:, env.frame] for step in steps]
    past = row(env, steps[2].critic, "history")
    torch.testing.assert_close(past, torch.cat([frames[1], frames[0]], dim=1))
    read = row(env, steps[2].policy, "history")
    torch.testing.assert_close(read, torch.cat([step.policy[:, env.frame] for step in (steps[1], steps[0])], dim=1))
    assert (read - past).abs().max() > 0.01


def test_encoders_that_are_off_show_without_any_noise(make_env, states):
    dynamics = DynamicsConfig(joint_offset_rad=0.05)
    env = make_env(8, carry=CarryBank.of(states, 0.005, torch.device("cpu"), dynamics=dynamics), dynamics=dynamics)
    env.reset()
    observation = env.step(torch.zeros(8, 20)).policy
    off = row(env, observation, "joint_pos") - row(env, env.policy_table(env.snapshot()), "joint_pos")
    offset = env.carry.joint_offset[env.memory.model]
    assert offset.abs().max() > 0.02 and not env.exact
    scale = (off * offset).sum() / (offset * offset).sum()
    torch.testing.assert_close(off, scale * offset, atol=1e-4, rtol=0)
    assert scale > 0.5


@pytest.mark.parametrize("bad", [{"joint_pos_rad": -1.0}, {"root_hz": float("inf")}, {"sensor_delay_steps": 2}])
def test_impossible_sensing_is_refused(bad):
    with pytest.raises(InvalidConfig, match=next(iter(bad))):
        replace(STUDENT_SENSING, **bad)
