"""Random numbers of an evaluation: every trial has its own robot, start, noise, delays and pushes.

They are decided by the seed, by the content of the scene and by the number of the trial, so that a scene gives the same
trials alone or among others, in any order, and no two scenes share theirs.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hotice.model.scene import Scene
from hotice.model.scene_digest import scene_digest

BLOCKS, OBJECTS, ROBOTS, ORDER = 101, 102, 103, 104
"""Streams of random numbers that no training draws from."""


@dataclass(frozen=True)
class TrialSeeds:
    """Seeds of the trials of one scene; `scene`: the first 64 bits of its digest."""

    seed: int
    scene: int

    @classmethod
    def of(cls, seed: int, scene: Scene) -> TrialSeeds:
        """Those of a scene in an evaluation with `seed`."""
        return cls(seed, int(scene_digest(scene)[:16], 16))

    def block(self, first: int) -> int:
        """Seed of what a block draws together, starts, noise, delays and pushes; `first`: number of its first trial."""
        return derived(self.seed, BLOCKS, self.scene, first)

    def robots(self, first: int, count: int) -> list[np.random.Generator]:
        """Generators from which the robots of trials `first` .. `first + count` are drawn, one each."""
        return [np.random.default_rng([self.seed, ROBOTS, self.scene, first + i]) for i in range(count)]

    def objects(self, rollouts: int, pool: int) -> np.ndarray:
        """Index of the object (of `pool`) that each trial carries, (rollouts,) int.

        The order is shuffled anew each time that all have been carried.
        """
        rng = np.random.default_rng([self.seed, ORDER, self.scene])
        rounds = [rng.permutation(pool) for _ in range(-(-rollouts // pool))]
        return np.concatenate(rounds)[:rollouts]


def object_seed(seed: int) -> int:
    """Seed of the pool of objects, which all scenes of an evaluation share."""
    return derived(seed, OBJECTS)


def derived(*numbers: int) -> int:
    """A seed made of several numbers."""
    return int(np.random.SeedSequence(numbers).generate_state(1, np.uint32)[0])
