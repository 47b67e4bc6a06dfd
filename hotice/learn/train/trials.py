"""Trials of the averaged policy beside a training run: a curve that exploration and curricula do not bend."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from hotice.learn.checkpoints.average import AveragedPolicy
from hotice.learn.ppo.networks import ActorCritic
from hotice.learn.train.config import TrainConfig
from hotice.sim.env import TransportEnv
from hotice.task.rules import OUTCOMES

SEED = 7919
"""Of starts, scenes and noise, the same every time: points of a curve differ by the policy alone."""


@dataclass(frozen=True, kw_only=True)
class TrialResults:
    """What N trials gave.

    scene, outcome: (N,) index of the scene, and into `OUTCOMES`. distance_m: (N,) root to goal at the end [m]. ways:
    (T, N, 2) root over time in W [m], at rest after the end.
    """

    scene: NDArray[np.int64]
    outcome: NDArray[np.int64]
    distance_m: NDArray[np.float64]
    ways: NDArray[np.float64]

    def log(self) -> dict[str, float]:
        """Shares of outcomes and mean distance, under `trials/`."""
        share = np.bincount(self.outcome, minlength=len(OUTCOMES)) / len(self.outcome)
        shares = {f"trials/{name}": float(share[i]) for i, name in enumerate(OUTCOMES) if name != "running"}
        return shares | {"trials/distance_m": float(self.distance_m.mean())}


class Trials:
    """An environment of `config.trials` robots beside that of a run, with its scenes, objects and perturbations.

    Trials begin at their scene's start and end at the goal, as in evaluation, but are judged as training is (sphere
    cover, physics of training): a curve to watch, not a score to report.
    """

    def __init__(self, env: TransportEnv, config: TrainConfig) -> None:
        task = replace(env.config, anywhere=0.0, end_at_goal=True, goal_stay_s=0.0, tolerance_m=0.0)
        self.env = TransportEnv(
            config.trials,
            env.bank,
            env.carry,
            config.preset,
            env.device,
            config.physics,
            SEED,
            config=task,
            threads=config.threads,
        )
        self.env.restarts = False

    @torch.no_grad()
    def run(self, net: ActorCritic, average: AveragedPolicy) -> TrialResults:
        """Walks all trials with the mean actions of the averaged policy; the newest where nothing is averaged."""
        policy = deepcopy(net)
        policy.load_state_dict(net.state_dict() | average.tensors)
        env = self.env
        env.generator.manual_seed(SEED)
        obs, _ = env.reset()
        outcome = torch.zeros(env.num_envs, dtype=torch.int64, device=env.device)
        distance, ways = torch.zeros(env.num_envs, device=env.device), []
        for _ in range(env.config.max_steps):
            step = env.step(policy.act(obs))
            obs, going = step.policy, outcome == 0
            distance[going] = step.goal_distance[going]
            place = env.physics.qpos[:, :2].clone()
            ways.append(place if not ways else torch.where(going[:, None], place, ways[-1]))
            outcome[going] = step.outcome[going]
            if bool((outcome > 0).all()):
                break
        return TrialResults(
            scene=_numpy(env.memory.scene),
            outcome=_numpy(outcome),
            distance_m=_numpy(distance).astype(np.float64),
            ways=_numpy(torch.stack(ways)).astype(np.float64),
        )


def _numpy(values: Tensor) -> NDArray:
    return values.cpu().numpy()
