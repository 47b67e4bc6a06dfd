"""A running average of what acts: weights of the actors and normaliser, the policy that is evaluated and exported.

Each update of PPO moves the weights by a step that is mostly noise; their average over recent updates walks with the
gradient but not with the noise, as if the steps had been small (Polyak and Juditsky 1992). The average never acts
during training.
"""

from __future__ import annotations

from collections.abc import Mapping

import torch
from torch import Tensor

from hotice.learn.ppo.networks import ActorCritic

PREFIX, COUNT = "average.", "average_count"
WARM_UP = 10


class AveragedPolicy:
    """Exponential average over updates; begins short, grows with the run (a tenth of it) up to its full length.

    Args:
        net: what is averaged. decay: share that an update keeps in the end, below 1; 0: there is no average.
    """

    def __init__(self, net: ActorCritic, decay: float) -> None:
        self.decay = decay
        self.restart(net)

    def restart(self, net: ActorCritic) -> None:
        """Forgets everything before the present weights."""
        self.count = 0
        self.tensors = {k: v.detach().clone() for k, v in net.state_dict().items() if _acts(k)} if self.decay else {}

    @torch.no_grad()
    def update(self, net: ActorCritic) -> None:
        """Takes in the weights after an update."""
        self.count += 1
        keep = min(self.decay, self.count / (WARM_UP + self.count))
        now = net.state_dict()
        for name, value in self.tensors.items():
            value.lerp_(now[name], 1.0 - keep)

    def state(self) -> dict[str, Tensor]:
        """Tensors for a checkpoint."""
        count = {COUNT: torch.tensor(self.count)} if self.decay else {}
        return {PREFIX + name: value for name, value in self.tensors.items()} | count

    def load_state(self, tensors: Mapping[str, Tensor]) -> None:
        """Restores `state`; a checkpoint without one leaves the average at the present weights."""
        if self.decay and COUNT in tensors:
            self.count = int(tensors[COUNT])
            for name, value in self.tensors.items():
                value.copy_(tensors[PREFIX + name])


def averaged(tensors: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """Tensors of a checkpoint with its average, where it has one, in place of the newest weights of what acts."""
    return dict(tensors) | {"net." + k.removeprefix(PREFIX): v for k, v in tensors.items() if k.startswith(PREFIX)}


def _acts(name: str) -> bool:
    """Whether a tensor of the networks is read when the policy acts."""
    return name in ("obs_norm.mean", "obs_norm.var") or ".actor." in name or name.endswith(".log_std")
