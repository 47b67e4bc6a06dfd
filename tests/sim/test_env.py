import dataclasses

import numpy as np
import pytest
import torch

from hotice.errors import HoticeError, InvalidConfig, UnknownName
from hotice.sim import TaskConfig, TransportEnv
from hotice.sim.physics import ram as memory_module
from hotice.sim.physics.ram import check_memory
from hotice.sim.rewards import TERMINATION_PENALTY
from hotice.task.rules import OUTCOMES


def actions(steps, num_envs=8, seed=0):
    return 0.6 * torch.randn(steps, num_envs, 20, generator=torch.Generator().manual_seed(seed))


def tensors(step):
    return {name: value for name, value in vars(step).items() if isinstance(value, torch.Tensor)}


def same(a, b, rows=slice(None)):
    return [k for k in tensors(a) if not torch.equal(getattr(a, k)[rows], getattr(b, k)[rows])]


def test_shapes_and_finiteness(env):
    for action in actions(30):
        step = env.step(action)
    assert step.policy.shape == (8, env.policy_table.size) and step.critic.shape == (8, env.critic_table.size)
    assert step.reward.shape == (8, 2) and step.terms.shape == (8, len(env.rewards.names))
    for name, value in tensors(step).items():
        assert len(value) == 8 and torch.isfinite(value.float()).all(), name


def test_zero_action_goes_on_holding_the_object(env):
    for _ in range(50):
        step = env.step(torch.zeros(8, 20))
        assert OUTCOMES.index("drop") not in step.outcome.tolist()


def test_the_same_seed_gives_the_same_episodes(make_env):
    def run(seed):
        env = make_env(8, seed=seed, push_m_s=0.5, push_interval_s=0.1, anywhere=0.5)
        env.reset()
        return [env.step(a) for a in actions(40)]

    first, second, other = run(1), run(1), run(2)
    assert sum(int((s.outcome > 0).sum()) for s in first) > 0
    assert all(same(a, b) == [] for a, b in zip(first, second, strict=True))
    assert "policy" in same(first[0], other[0])


def test_state_goes_on_bit_for_bit_also_in_another_environment(make_env):
    def make(seed):
        return make_env(8, seed=seed, push_m_s=0.5, push_interval_s=0.1, episode_s=0.5)

    env, other = make(1), make(2)
    env.reset(), other.reset()
    for a in actions(17):
        before = env.step(a)
    saved = env.state()
    expected = [env.step(a) for a in actions(20, seed=7)]
    assert sum(int((s.outcome > 0).sum()) for s in expected) > 0
    for e in (env, other):
        policy, critic = e.load_state(saved)
        assert torch.equal(policy, before.policy) and torch.equal(critic, before.critic)
        for step, a in zip(expected, actions(20, seed=7), strict=True):
            assert same(e.step(a), step) == []


def test_saved_state_is_a_copy(env):
    saved = env.state()
    kept = {k: v.clone() for k, v in saved.items()}
    env.step(actions(1)[0])
    assert all(torch.equal(saved[k], kept[k]) for k in kept)


@pytest.mark.parametrize("field, value", [("qvel", float("nan")), ("qvel", 1e12), ("qpos", float("inf"))])
def test_a_diverged_simulation_ends_as_unstable_and_harms_nobody(moving, field, value):
    env, action = moving, actions(2)[1]
    saved = env.state()
    expected = env.step(action)
    env.load_state(saved)
    column = 9 if field == "qpos" else 5
    getattr(env.physics, field)[2, column] = value
    step = env.step(action)
    assert OUTCOMES[int(step.outcome[2])] == "unstable" and step.terminated[2] and not step.truncated[2]
    assert env.unstable == 1
    rest = [0, 1, 3, 4, 5, 6, 7]
    assert (expected.outcome == 0).all() and same(step, expected, rest) == []
    assert (step.reward[2] == TERMINATION_PENALTY).all() and (step.terms[2] == 0).all()
    for name, tensor in tensors(step).items():
        assert torch.isfinite(tensor.float()).all(), name
    after = env.step(action)
    assert all(torch.isfinite(t.float()).all() for t in tensors(after).values())
    assert int(after.length[2]) == 1 and after.outcome[2] == 0


@pytest.mark.parametrize("value", [float("nan"), float("inf"), float("-inf")])
def test_an_action_that_is_not_finite_ends_the_episode_as_unstable_and_harms_nobody(moving, value):
    env, action = moving, actions(2)[1]
    saved, counted = env.state(), (env.unstable, env.invalid_actions)
    expected = env.step(action)
    env.load_state(saved)
    bad = action.clone()
    bad[2, 7] = value
    step = env.step(bad)
    assert OUTCOMES[int(step.outcome[2])] == "unstable" and step.terminated[2] and not step.truncated[2]
    assert (env.unstable, env.invalid_actions) == (counted[0] + 1, counted[1] + 1)
    assert (step.reward[2] == TERMINATION_PENALTY).all()
    assert (expected.outcome == 0).all() and same(step, expected, [0, 1, 3, 4, 5, 6, 7]) == []
    assert all(torch.isfinite(t.float()).all() for t in tensors(step).values())


def test_actions_are_scaled_clipped_offsets_of_the_carry_targets(env):
    action = torch.zeros(8, 20)
    action[0, 3], action[1, 15], action[2, 0] = 1.0, -1.0, 100.0
    env.step(action)
    offset = env.physics.ctrl.float() - env.carry.target[env.memory.model]
    cfg = env.config
    assert float(offset[0, 3]) == pytest.approx(cfg.leg_scale_rad, abs=1e-5)
    assert float(offset[1, 15]) == pytest.approx(-cfg.arm_scale_rad, abs=1e-5)
    assert float(offset[2, 0]) == pytest.approx(cfg.leg_scale_rad * cfg.action_limit, abs=1e-5)
    assert offset.abs().sum() == pytest.approx(float(offset[0, 3] - offset[1, 15] + offset[2, 0]), abs=1e-4)


def test_last_action_and_clock(env):
    a, b = actions(2)
    phase = env.memory.phase.clone()
    env.step(a), env.step(b)
    s = env.snapshot()
    assert torch.equal(s.action, b) and torch.equal(s.last_action, a)
    expected = (phase + 2 * 2 * torch.pi * env.config.gait_hz * env.config.control_dt_s) % (2 * torch.pi)
    torch.testing.assert_close(s.phase, expected, atol=1e-5, rtol=0)
    torch.testing.assert_close(s.time_left, torch.full((8,), 1 - 2 / env.config.max_steps))


def test_starts_lie_within_their_ranges_and_use_them(make_env):
    env = make_env(64, start_noise_m=0.05, start_yaw_noise_rad=0.15, joint_noise_rad=0.02)
    env.reset()
    s = env.snapshot()
    start = env.bank.start[env.memory.scene]
    place, yaw = (s.p_WP[:, :2] - start[:, :2]), s.yaw - start[:, 2]
    legs = (s.q - s.grasp.joint_pos)[:, :12]
    for value, half in ((place, 0.05), (yaw, 0.15), (legs, 0.02)):
        assert value.abs().max() <= half + 1e-5
        assert value.max() > 0.8 * half and value.min() < -0.8 * half
        assert abs(float(value.mean())) < 0.3 * half
    assert (s.q - s.grasp.joint_pos)[:, 12:].abs().max() < 1e-6
    assert (env.physics.qvel == 0).all()
    phases = env.memory.phase
    assert 0.2 < float((phases == 0).float().mean()) < 0.8 and set(phases.unique().tolist()) <= {
        0.0,
        float(np.float32(np.pi)),
    }
    assert set(env.memory.scene.tolist()) == {0, 1, 2}


def test_the_object_starts_in_the_hands_whatever_the_heading(make_env):
    env = make_env(32, anywhere=1.0, start_yaw_noise_rad=0.5)
    env.reset()
    s = env.snapshot()
    hands = (s.p_WK[:, 9:11] - s.p_WO[:, None]) @ s.R_WO
    torch.testing.assert_close(hands, s.grasp.p_OH, atol=1e-5, rtol=0)


def test_starts_anywhere_have_room_and_a_way(make_env):
    env = make_env(64, anywhere=1.0)
    env.reset()
    s = env.snapshot()
    assert (s.clearance > 0.0).all() and (s.object_clearance > 0.0).all()
    assert float((s.p_WP[:, :2] - env.bank.start[env.memory.scene, :2]).norm(dim=1).max()) > 0.5
    assert (s.goal_distance > 0.2).all()


def test_scenes_are_drawn_by_weight(make_env):
    env = make_env(32)
    env.starter.scene_weight[:] = torch.tensor([0.0, 1.0, 0.0])
    env.reset()
    assert (env.memory.scene == 1).all()


def test_pushes_change_the_velocity_of_the_root_within_their_size(make_env):
    env = make_env(32, push_m_s=0.7, push_interval_s=0.02)
    env.reset()
    from hotice.sim.events import push

    push(env.physics, env.config, env.generator)
    size = env.physics.qvel[:, :2].norm(dim=1)
    assert 0.5 < size.max() <= 0.7 and size.min() >= 0.069 and (env.physics.qvel[:, 2:] == 0).all()
    calm = dataclasses.replace(env.config, push_m_s=0.0)
    before = env.physics.qvel.clone()
    push(env.physics, calm, env.generator)
    assert torch.equal(env.physics.qvel, before)


@pytest.mark.parametrize("preset, agents", [("dual_sgf", 2), ("single_hodpf", 1), ("single_sgf", 1)])
def test_every_preset_steps_and_reads_the_same_layout(make_env, shared_env, preset, agents):
    env = make_env(2, preset)
    env.reset()
    step = env.step(torch.zeros(2, 20))
    assert step.reward.shape == (2, agents)
    assert env.policy_table.layout() == shared_env.policy_table.layout()


@pytest.mark.parametrize(
    "arguments, error, message",
    [
        (dict(num_envs=0), InvalidConfig, "at least 1"),
        (dict(num_envs=10**9), InvalidConfig, "GiB"),
        (dict(preset="triple"), UnknownName, "dual_hodpf"),
        (dict(physics="bullet"), UnknownName, "mujoco"),
        (dict(scenes=[]), InvalidConfig, "no scenes"),
    ],
)
def test_what_cannot_be_built_says_so(bank, carry, arguments, error, message):
    with pytest.raises(error, match=message) as caught:
        TransportEnv(**(dict(num_envs=2, scenes=bank, objects=carry) | arguments))
    assert isinstance(caught.value, HoticeError) and "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["physics_dt_s", "episode_s", "speed_m_s", "margin_m", "push_m_s", "tolerance_m"])
@pytest.mark.parametrize("value", [-1.0, float("nan"), float("inf")])
def test_impossible_numbers_are_refused(name, value):
    with pytest.raises(InvalidConfig, match=name):
        TaskConfig(**{name: value})


def test_memory_is_checked_before_it_is_used(monkeypatch):
    monkeypatch.setattr(memory_module, "available_bytes", lambda: 2**30)
    check_memory(100)
    with pytest.raises(InvalidConfig, match=r"5,000 simulations .* 3\.3 GiB .* 1\.0 GiB are available: ask for fewer"):
        check_memory(5000)
    with pytest.raises(InvalidConfig, match="1,000,000,000 trials"):
        check_memory(1, 10**9)
