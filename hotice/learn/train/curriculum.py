"""Choice of what to train on next: failing scenes before solved ones, near goals and small objects first."""

from __future__ import annotations

import torch
from torch import Tensor

from hotice.sim.events import Starter

RUNGS = 10
RISE, FALL = 0.7, 0.2


class SceneCurriculum:
    """Scenes drawn in proportion to `floor` + 4 q (1 − q), q = max(p, ½), p the running rate of goals reached.

    Scenes that fail in half of their episodes or more have the same weight; above that it falls to `floor` at p = 1. p
    starts at a half, so that every scene is tried; goal success counts, not survival: a robot that stops before an
    obstacle has not learnt to pass it.
    """

    def __init__(self, num_scenes: int, device: torch.device, floor: float = 0.25, memory: float = 60.0) -> None:
        self.floor, self.memory = floor, memory
        self.rate = torch.full((num_scenes,), 0.5, device=device)

    def update(self, ended: Tensor, successes: Tensor) -> None:
        """Takes in episodes that ended and those of them that had reached the goal, (S,) each."""
        share = ended / (ended + self.memory)
        mean = successes / ended.clamp_min(1.0)
        self.rate += share * (mean - self.rate)

    def weights(self) -> Tensor:
        """Sampling weights, (S,)."""
        q = self.rate.clamp_min(0.5)
        return self.floor + 4.0 * q * (1.0 - q)


class Stages:
    """Goal distance and object size grow, rung by rung, with the rate of reaching the goal.

    Once so many episodes have ended as there are environments (of all ranks), their rate decides: above `RISE` the
    lower of the two climbs a rung, below `FALL` the higher goes back one. On the top rung the task is whole.

    Args:
        starter: of the environment; draws starts and objects.
        first_m: longest way to the goal on the bottom rung [m]; 0: starts are not held back.
        first_share: share of the objects, the smallest, on the bottom rung; 0: objects are not held back.
        episodes: how many decide.
    """

    def __init__(self, starter: Starter, first_m: float, first_share: float, episodes: int) -> None:
        self.starter, self.first_m, self.first_share, self.episodes = starter, first_m, first_share, episodes
        self.rung = {name: 0 for name, first in (("distance", first_m), ("objects", first_share)) if first > 0}
        self.ended = self.successes = 0.0
        starter.hold_back(far="distance" in self.rung, large="objects" in self.rung)
        self._apply()

    def update(self, ended: float, successes: float) -> None:
        """Takes in episodes that ended and those of them that had reached the goal."""
        self.ended, self.successes = self.ended + ended, self.successes + successes
        if not self.rung or self.ended < self.episodes:
            return
        rate, self.ended, self.successes = self.successes / self.ended, 0.0, 0.0
        lower, higher = min(self.rung, key=self.rung.__getitem__), max(self.rung, key=self.rung.__getitem__)
        if rate > RISE:
            self.rung[lower] = min(RUNGS, self.rung[lower] + 1)
        elif rate < FALL:
            self.rung[higher] = max(0, self.rung[higher] - 1)
        self._apply()

    def log(self) -> dict[str, float]:
        """Limits that hold now."""
        near, small = self.starter.near, self.starter.small
        shown = {"curriculum/distance_m": near.limit_m} if near is not None else {}
        return shown | ({"curriculum/objects": small.share} if small is not None else {})

    def state(self) -> dict[str, Tensor]:
        """Where it stands, for checkpoints; empty when nothing is held back."""
        counts = {"ended": self.ended, "successes": self.successes}
        return {f"stages.{k}": torch.tensor(v) for k, v in (counts | self.rung).items()} if self.rung else {}

    def load_state(self, tensors: dict[str, Tensor]) -> None:
        """Restores `state`; what was not held back in that run stays on the bottom rung."""
        if "stages.ended" not in tensors:
            return
        self.ended, self.successes = (float(tensors[f"stages.{k}"]) for k in ("ended", "successes"))
        self.rung = {name: int(tensors.get(f"stages.{name}", torch.tensor(0))) for name in self.rung}
        self._apply()

    def _apply(self) -> None:
        near, small = self.starter.near, self.starter.small
        if near is not None:
            level = self.rung["distance"] / RUNGS
            near.limit_m = self.first_m + level * max(0.0, near.farthest_m - self.first_m)
        if small is not None:
            small.share = self.first_share + self.rung["objects"] / RUNGS * (1.0 - self.first_share)
