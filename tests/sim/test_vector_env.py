import subprocess
import sys

import gymnasium
import numpy as np
import pytest
from gymnasium.utils import env_checker
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers.vector import ClipReward, RecordEpisodeStatistics

from hotice.errors import InvalidConfig
from hotice.sim import HoticeVectorEnv
from hotice.task.sensing import STUDENT_SENSING


@pytest.fixture
def vector(make_env):
    return HoticeVectorEnv(make_env(4, episode_s=0.1))


def test_spaces(vector):
    env = vector.env
    assert vector.num_envs == 4 and isinstance(vector, gymnasium.vector.VectorEnv)
    assert vector.single_observation_space.shape == (env.policy_table.size,)
    assert vector.single_action_space.shape == (20,) and vector.action_space.shape == (4, 20)
    assert float(vector.single_action_space.high.max()) == env.config.action_limit
    assert vector.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
    observation, info = vector.reset(seed=0)
    assert observation in vector.observation_space and info["critic"].shape == (4, env.critic_table.size)


@pytest.mark.parametrize("check", ["check_reset_seed_determinism", "check_reset_options", "check_reset_return_type"])
def test_gymnasiums_own_checks_that_hold_for_vector_environments(vector, check):
    getattr(env_checker, check)(vector)


def test_equal_seeds_give_equal_rollouts(vector):
    vector.action_space.seed(0)
    actions = [0.2 * vector.action_space.sample() for _ in range(8)]

    def rollout(seed):
        first, _ = vector.reset(seed=seed)
        return [first] + [vector.step(a)[0] for a in actions]

    a, b, c = rollout(1), rollout(1), rollout(2)
    for x, y in zip(a, b, strict=True):
        np.testing.assert_array_equal(x, y)
    assert not np.array_equal(a[0], c[0])


def test_rewards_are_the_sum_of_the_streams(vector):
    vector.reset(seed=0)
    observation, reward, terminated, truncated, info = vector.step(np.zeros((4, 20)))
    assert observation in vector.observation_space
    assert reward.shape == (4,) and reward.dtype == np.float32 and terminated.dtype == truncated.dtype == np.bool_
    np.testing.assert_allclose(reward, info["agent_rewards"].sum(axis=1), rtol=1e-6)
    assert info["agent_rewards"].shape == (4, 2) and info["_agent_rewards"].all() and vector.agents == ("low", "up")
    assert "final_obs" not in info


def test_an_ended_episode_starts_anew_in_the_same_step(vector):
    vector.reset(seed=0)
    for _ in range(5):
        observation, _, terminated, truncated, info = vector.step(np.zeros((4, 20)))
    assert truncated.all() and not terminated.any()
    assert info["_final_obs"].all() and info["final_obs"].dtype == object
    final = np.stack(list(info["final_obs"]))
    np.testing.assert_array_equal(final, info["final_info"]["critic"][:, : final.shape[1]])
    assert not np.array_equal(final, observation)
    assert info["final_info"]["outcome"].tolist() == ["timeout"] * 4
    assert info["final_info"]["episode_steps"].tolist() == [5] * 4
    np.testing.assert_array_equal(vector.env.memory.step.numpy(), 0)
    np.testing.assert_array_equal(observation, vector.env.policy_table(vector.env.snapshot()).numpy())


def test_the_last_observation_is_what_the_robot_read(make_env):
    vector, longer = (HoticeVectorEnv(make_env(4, episode_s=s, sensing=STUDENT_SENSING)) for s in (0.1, 5.0))
    for env in (vector, longer):
        env.reset(seed=0)
        for _ in range(5):
            observation, *_, info = env.step(np.zeros((4, 20)))
        if env is vector:
            ended = info
    final = np.stack(list(ended["final_obs"]))
    np.testing.assert_array_equal(final, observation, "what it would have read, had the episode gone on")
    assert np.abs(final - ended["final_info"]["critic"][:, : final.shape[1]]).max() > 0.01


def test_only_the_rows_that_ended_have_final_values(vector):
    vector.reset(seed=0)
    vector.env.physics.qpos[1, 29] -= 0.7
    _, _, terminated, _, info = vector.step(np.zeros((4, 20)))
    assert terminated.tolist() == info["_final_obs"].tolist() == [False, True, False, False]
    assert info["final_obs"][0] is None and info["final_obs"][1].shape == vector.single_observation_space.shape
    assert info["final_info"]["outcome"].tolist() == ["", "drop", "", ""]


def test_what_was_returned_does_not_change_later(vector):
    observation, info = vector.reset(seed=0)
    kept = observation.copy(), info["critic"].copy()
    vector.step(np.ones((4, 20)))
    np.testing.assert_array_equal(observation, kept[0])
    np.testing.assert_array_equal(info["critic"], kept[1])


def test_gymnasiums_wrappers_work(vector):
    wrapped = RecordEpisodeStatistics(ClipReward(vector, -1.0, 1.0))
    wrapped.reset(seed=0)
    for _ in range(5):
        info = wrapped.step(np.zeros((4, 20)))[-1]
    assert info["episode"]["l"].tolist() == [5] * 4
    wrapped.close()
    assert vector.closed


@pytest.mark.parametrize("actions", [np.zeros((4, 19)), np.zeros((3, 20)), np.full((4, 20), np.nan)])
def test_wrong_actions_are_refused(vector, actions):
    vector.reset(seed=0)
    with pytest.raises(ValueError, match=r"\(4, 20\)"):
        vector.step(actions)


def test_made_from_keyword_arguments(bank, carry):
    vector = HoticeVectorEnv(dict(num_envs=1, scenes=bank, objects=carry, threads=1, preset="single_hodpf"))
    assert vector.agents == ("whole",) and vector.reset(seed=0)[0].shape[0] == 1
    with pytest.raises(InvalidConfig, match="TransportEnv or its keyword arguments"):
        HoticeVectorEnv(3)


def test_importing_the_simulation_does_not_import_gymnasium():
    code = (
        "import sys, hotice.sim as s; a = 'gymnasium' in sys.modules; s.HoticeVectorEnv; "
        "print(a, 'gymnasium' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert done.stdout.split() == ["False", "True"]
