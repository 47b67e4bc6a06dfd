"""Generalised advantage estimation, for several reward streams at once."""

from __future__ import annotations

import torch
from torch import Tensor


def gae(
    reward: Tensor,
    value: Tensor,
    last_value: Tensor,
    final_value: Tensor,
    terminated: Tensor,
    truncated: Tensor,
    gamma: float,
    lam: float,
) -> Tensor:
    """Advantages (T, N, A) of A streams (Schulman et al. 2016).

    Args:
        reward, value: (T, N, A). last_value: (N, A) of the observation after the last step.
        final_value: (T, N, A) of the observation that ended an episode by time out; used where `truncated`.
        terminated, truncated: (T, N) bool. After either, nothing of the next episode flows back.
    """
    advantage = torch.zeros_like(reward)
    running = torch.zeros_like(last_value)
    following = last_value
    for t in range(reward.shape[0] - 1, -1, -1):
        done = (terminated[t] | truncated[t])[:, None]
        # A time out is no end of the task: the value of the observation that it cut off stands for what would have
        # followed. After an end there is nothing.
        bootstrap = torch.where(truncated[t][:, None], final_value[t], following)
        bootstrap = torch.where(terminated[t][:, None], torch.zeros_like(bootstrap), bootstrap)
        delta = reward[t] + gamma * bootstrap - value[t]
        # The row after an end belongs to another episode.
        running = delta + gamma * lam * torch.where(done, torch.zeros_like(running), running)
        advantage[t] = running
        following = value[t]
    return advantage
