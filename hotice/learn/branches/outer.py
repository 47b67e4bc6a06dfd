"""The outer step: from the last average by way of the mean of the branches to the next one.

The way back from the mean to the last average, θ − mean(θ_k), stands for a gradient (Douillard et al. 2023, "DiLoCo"),
with Nesterov momentum in the form of `torch.optim.SGD`:

    g = θ − mean(θ_k),   v ← μ v + g,   θ ← θ − α (g + μ v)

With α = 1 and μ = 0 the next average is the mean itself (local SGD; Stich 2019), to the last bit.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from torch import Tensor

from hotice.learn.branches.config import BranchConfig


@dataclass(frozen=True, kw_only=True)
class OuterStep:
    """Learning rate α and momentum μ."""

    learning_rate: float = 1.0
    momentum: float = 0.0

    @classmethod
    def of(cls, config: BranchConfig) -> OuterStep:
        """The step that a run was asked for."""
        return cls(learning_rate=config.outer_learning_rate, momentum=config.outer_momentum)

    def __call__(
        self, before: Mapping[str, Tensor], mean: Mapping[str, Tensor], velocity: Mapping[str, Tensor]
    ) -> tuple[dict[str, Tensor], dict[str, Tensor]]:
        """Weights and velocity after the step, by name, both of the kinds of numbers that the weights are.

        before: the last average. mean: of the branches; its names count. velocity: of the last step; what it lacks was
        at rest.
        """
        if self.learning_rate == 1 and self.momentum == 0:
            return dict(mean), {}
        after: dict[str, Tensor] = {}
        moving: dict[str, Tensor] = {}
        for name, target in mean.items():
            gradient = before[name].double() - target.double()
            speed = gradient
            if name in velocity:
                speed = self.momentum * velocity[name].double() + gradient
            step = self.learning_rate * (gradient + self.momentum * speed)
            after[name] = (before[name].double() - step).to(target.dtype)
            if self.momentum:
                moving[name] = speed.to(target.dtype)
        return after, moving
