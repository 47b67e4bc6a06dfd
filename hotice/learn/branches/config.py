"""Branches of a training run in numbers. Sources: Stich 2019, Douillard et al. 2023 (DiLoCo), or ours."""

from __future__ import annotations

from dataclasses import dataclass

from hotice import checks
from hotice.checks import Range

MOST_BRANCHES = 1024


@dataclass(frozen=True, kw_only=True)
class BranchConfig:
    """Branches: how many, how often they are averaged, and how far the run then goes towards their mean."""

    branches: int = 1
    """Processes that train apart from the same weights, and are averaged now and then."""
    merge_every: int = 1_000_000
    """Environment steps of each branch between two averages, rounded up to whole updates (ours: some 500 steps of the
    optimiser, as in DiLoCo)."""
    outer_learning_rate: float = 1.0
    """Share of the way from the last average to the mean of the branches that the next one lies at; 1: it is their mean
    (Stich 2019; DiLoCo 0.7)."""
    outer_momentum: float = 0.0
    """Nesterov momentum of the way from average to average; 0: none (DiLoCo 0.9)."""

    def __post_init__(self) -> None:
        checks.whole("branches", self.branches, Range(least=1, most=MOST_BRANCHES))
        checks.wholes(self, Range(least=1, most=2**63 - 1), "merge_every")
        checks.number("outer_learning_rate", self.outer_learning_rate, Range(above=0, most=2))
        checks.number("outer_momentum", self.outer_momentum, Range(least=0, below=1))

    @property
    def several(self) -> bool:
        """Whether averages are taken: one branch that is its own average trains as if there were none."""
        return self.branches > 1 or not self.plain

    @property
    def plain(self) -> bool:
        """Whether the run goes on from the mean itself."""
        return self.outer_learning_rate == 1 and self.outer_momentum == 0

    def updates(self, steps: int) -> int:
        """Updates between two averages, of `steps` environment steps each."""
        return -(-self.merge_every // steps)
