"""A checkpoint as a network that reads and gives NumPy arrays, for what runs policies without torch."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from hotice.learn.policy import TorchPolicy, torch_policy


class TorchNetwork:
    """The networks of a checkpoint, as `hotice.policy.PolicySession` is of a file."""

    def __init__(self, policy: TorchPolicy) -> None:
        self._policy = policy
        self.name: str = policy.name
        self.meta: dict[str, Any] = policy.meta

    @classmethod
    def load(cls, path: Path) -> TorchNetwork:
        """A checkpoint, or the newest of a run. Raises `CheckpointError`."""
        return cls(torch_policy(path))

    @property
    def layout(self) -> list[tuple[str, int]]:
        """Names and widths of the observation's rows."""
        return [(str(name), int(width)) for name, width in self.meta["layout"]]

    def run(self, observation: NDArray[np.float32]) -> NDArray[np.float32]:
        """Actions (N, 20) of raw observations (N, O)."""
        return self._policy.act(torch.from_numpy(observation)).numpy()
