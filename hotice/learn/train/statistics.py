"""Counts of how episodes end, while training."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from hotice.model.generate.family_names import family_of
from hotice.sim.batch_env import Step
from hotice.task.rules import OUTCOMES


class EpisodeStatistics:
    """Collects ended episodes since the last `pop`, in all and by scene.

    Success here is the first arrival: the root came within the goal radius before robot or object had touched an
    obstacle and before the episode ended, whatever ended it. Episodes that did not begin at their first step, as the
    first ones of a run do not, do not count: they had less time. `whole` (N,) bool: those under way that do.
    """

    def __init__(self, num_envs: int, num_scenes: int, device: torch.device) -> None:
        self.reached = torch.zeros(num_envs, dtype=torch.bool, device=device)
        self.touched = torch.zeros(num_envs, dtype=torch.bool, device=device)
        self.whole = torch.ones(num_envs, dtype=torch.bool, device=device)
        self.ended = torch.zeros(num_scenes, device=device)
        self.outcomes = torch.zeros(len(OUTCOMES), device=device)
        self.successes = torch.zeros(num_scenes, device=device)
        self.collisions = torch.zeros(num_scenes, device=device)
        self.distance = torch.zeros((), device=device)
        self.length = torch.zeros((), device=device)

    @property
    def counters(self) -> tuple[Tensor, ...]:
        """Sums that `pop` reads and clears."""
        return self.ended, self.outcomes, self.successes, self.collisions, self.distance, self.length

    def add(self, step: Step) -> None:
        """Takes in one control step."""
        self.touched |= step.touched
        self.reached |= step.reached & ~self.touched
        over = step.outcome > 0
        done = over & self.whole
        scene = step.scene[done]
        ones = torch.ones(len(scene), device=scene.device)
        collided = step.outcome[done]
        hit = (collided == OUTCOMES.index("robot_collision")) | (collided == OUTCOMES.index("object_collision"))
        self.ended.index_add_(0, scene, ones)
        self.outcomes += torch.bincount(step.outcome[done], minlength=len(OUTCOMES))
        self.successes.index_add_(0, scene, self.reached[done].float())
        self.collisions.index_add_(0, scene, hit.float())
        self.distance += step.goal_distance[done].sum()
        self.length += step.length[done].sum()
        self.reached[over] = False
        self.touched[over] = False
        self.whole[over] = True

    def pop(self) -> tuple[dict[str, float], Tensor, Tensor]:
        """Means since the last call, ended episodes and successes by scene (S,); then starts anew."""
        total = float(self.ended.sum())
        result = {"episodes": total}
        if total:
            result |= {
                f"share/{n}": float(c) / total for n, c in zip(OUTCOMES, self.outcomes, strict=True) if n != "running"
            }
            result["share/reached"] = float(self.successes.sum()) / total
            result["distance_m"] = float(self.distance) / total
            result["length"] = float(self.length) / total
        ended, successes = self.ended.clone(), self.successes.clone()
        for counter in self.counters:
            counter.zero_()
        return result, ended, successes


def by_family(names: Sequence[str], ended: Tensor, successes: Tensor) -> dict[str, float]:
    """Share of arrivals in each family of scenes in which episodes ended, under `family/`.

    names: of S scenes; those of no family count as `other`. ended, successes: (S,) of each scene, see
    `EpisodeStatistics.pop`.
    """
    sums: dict[str, list[float]] = {}
    for name, n, good in zip(names, ended.tolist(), successes.tolist(), strict=True):
        if n:
            both = sums.setdefault(family_of(name) or "other", [0.0, 0.0])
            both[0], both[1] = both[0] + n, both[1] + good
    return {f"family/{family}": good / n for family, (n, good) in sorted(sums.items())}
