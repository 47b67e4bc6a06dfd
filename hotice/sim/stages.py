"""Stages that a curriculum may hold back at first: starts far from the goal, and large objects.

Nothing here is random by itself or learns; `hotice.learn.train.curriculum.Stages` says how much is allowed. What the
starts are is in `hotice.sim.starts`.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

from hotice.fields.bank import FieldBank
from hotice.model.scene import GOAL_HEIGHT_M
from hotice.sim.snapshot import Grasp


class NearStarts:
    """Start places of S scenes, nearest to the goal first; those within `limit_m` may be drawn, at least one.

    Args:
        bank: the scenes' fields.
        places (S, P, 3): x, y [m], heading [rad]; of the rows of a scene the first `count` (S,) hold.
    """

    def __init__(self, bank: FieldBank, places: Tensor, count: Tensor) -> None:
        ids = torch.arange(bank.num_scenes, device=places.device)
        way_m = _way(bank, ids, places)
        way_m[torch.arange(places.shape[1], device=places.device) >= count[:, None]] = math.inf
        self.way_m, order = way_m.sort(dim=1, stable=True)
        self.places = places.gather(1, order[:, :, None].expand_as(places))
        self.own_m = _way(bank, ids, bank.start[:, None])[:, 0]
        """Way from each scene's own start to the goal, (S,) [m]."""
        self.farthest_m = max(float(self.own_m.max()), float(self.way_m[self.way_m.isfinite()].max()))
        self.limit_m = self.farthest_m

    def draw(self, scene: Tensor, generator: torch.Generator) -> Tensor:
        """Places (n, 3) within the limit, of scenes (n,)."""
        within = (self.way_m <= self.limit_m).sum(dim=1).clamp_min(1)[scene]
        share = torch.rand(len(scene), generator=generator, device=scene.device)
        return self.places[scene, torch.minimum((share * within).long(), within - 1)]

    def too_far(self, scene: Tensor) -> Tensor:
        """Whether the own start of scenes (n,) is beyond the limit, (n,) bool."""
        return self.own_m[scene] > self.limit_m


def _way(bank: FieldBank, ids: Tensor, places: Tensor) -> Tensor:
    """Geodesic distance to the goal at pelvis height, (S, P) [m]."""
    at_pelvis = torch.cat([places[:, :, :2], torch.full_like(places[:, :, :1], GOAL_HEIGHT_M)], dim=2)
    return bank.sample("sgf", ids, at_pelvis).geodesic.clone()


class SmallObjects:
    """M carry states in the order of their object's size, its diagonal; the smallest `share` of them may be drawn."""

    def __init__(self, grasp: Grasp) -> None:
        self.order = grasp.half_extents.norm(dim=1).sort(stable=True).indices
        self.share = 1.0

    def draw(self, count: int, generator: torch.Generator) -> Tensor:
        """Ids (count,) of carry states."""
        allowed = max(1, math.ceil(self.share * len(self.order)))
        return self.order[torch.randint(0, allowed, (count,), generator=generator, device=self.order.device)]
