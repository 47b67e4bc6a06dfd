"""The transport task as a `gymnasium.vector.VectorEnv`, for learners that speak gymnasium.

Like `TransportEnv`, an environment whose episode ends starts anew in the same step: `metadata["autoreset_mode"]` is
`AutoresetMode.SAME_STEP`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np
import torch
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import ArrayLike, NDArray

from hotice.errors import InvalidConfig
from hotice.sim.env import TransportEnv
from hotice.task.rules import OUTCOMES


class HoticeVectorEnv(VectorEnv[NDArray[np.float32], NDArray[np.float32], NDArray[Any]]):
    """N transport tasks with NumPy arrays in and out.

    Observation: `Box(O,)` float32, what the actors read (`hotice tables` lists it). Action: `Box(20,)` float32 within ±
    the task's `action_limit`, offsets of the joint targets in action units, legs first. Reward (N,): the sum of the
    agents' reward streams; with two agents a shared term therefore counts twice, once a stream. The streams themselves
    are `info["agent_rewards"]` (N, A), in the order of `agents`.

    Info of a step, each with a mask `_key` of the rows it holds for: `agent_rewards` (N, A), `critic` (N, C) privileged
    observations. Where an episode ended: `final_obs`, an object array of observations (O,) before the restart, and
    `final_info` with `outcome` (N,) (a name of `hotice.task.rules.OUTCOMES`), `critic`, `goal_distance_m` and
    `episode_steps`.

    Args:
        env: a `TransportEnv`, or the keyword arguments of one.

    Raises:
        InvalidConfig: for another `env`. Actions of a wrong shape or that are not finite raise `ValueError`.
    """

    metadata: dict[str, Any] = {"autoreset_mode": AutoresetMode.SAME_STEP, "render_modes": []}

    def __init__(self, env: TransportEnv | Mapping[str, Any]) -> None:
        if isinstance(env, Mapping):
            env = TransportEnv(**env)
        if not isinstance(env, TransportEnv):
            raise InvalidConfig(f"env is a {type(env).__name__}: a TransportEnv or its keyword arguments are needed")
        self.env = env
        self.agents = tuple(a.name for a in env.agents)
        self.num_envs = env.num_envs
        limit = env.config.action_limit
        self.single_observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (env.policy_table.size,), np.float32)
        self.single_action_space = gymnasium.spaces.Box(-limit, limit, (env.num_actions,), np.float32)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Starts every episode; `seed` sets the environment's generator, `options` are not used."""
        super().reset(seed=seed)
        if seed is not None:
            self.env.generator.manual_seed(seed)
        policy, critic = self.env.reset()
        return _numpy(policy), self._info(critic=_numpy(critic))

    def step(
        self, actions: ArrayLike
    ) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """One control step with actions (N, 20): observations, rewards, terminations, truncations, info."""
        action = np.array(actions, dtype=np.float32)
        if action.shape != self.action_space.shape or not np.isfinite(action).all():
            raise ValueError(
                f"actions of shape {action.shape}: finite numbers of shape {self.action_space.shape} are needed"
            )
        step = self.env.step(torch.from_numpy(action))
        info = self._info(agent_rewards=_numpy(step.reward), critic=_numpy(step.critic))
        done = _numpy(step.outcome > 0)
        if done.any():
            final, read = _numpy(step.final_critic), _numpy(step.final_policy)
            rows = np.full(self.num_envs, None, dtype=object)
            for i in np.flatnonzero(done):
                rows[i] = read[i].copy()
            names = np.array(OUTCOMES)[_numpy(step.outcome)]
            info |= {"final_obs": rows, "_final_obs": done.copy(), "_final_info": done.copy()}
            info["final_info"] = self._info(
                done,
                outcome=np.where(done, names, ""),
                critic=np.where(done[:, None], final, 0.0),
                goal_distance_m=np.where(done, _numpy(step.goal_distance), 0.0),
                episode_steps=np.where(done, _numpy(step.length), 0),
            )
        reward = _numpy(step.reward.sum(dim=1))
        return _numpy(step.policy), reward, _numpy(step.terminated), _numpy(step.truncated), info

    def _info(self, rows: NDArray[np.bool_] | None = None, **values: NDArray[Any]) -> dict[str, Any]:
        mask = np.ones(self.num_envs, dtype=bool) if rows is None else rows
        return {k: v for key, value in values.items() for k, v in ((key, value), (f"_{key}", mask.copy()))}


def _numpy(tensor: torch.Tensor) -> NDArray[Any]:
    """A copy, so that what a learner keeps does not change."""
    return tensor.detach().cpu().numpy().copy()
