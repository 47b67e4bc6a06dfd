"""Fields of what stands still and of what moves, together: the questions that a `FieldBank` answers, of one moment."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from hotice.fields.bank import FIELDS, FieldBank, FieldSample
from hotice.fields.clearance import Spheres
from hotice.fields.moving.course import Movers
from hotice.fields.moving.distance import mover_clearance, mover_distance, nearest_mover, repulsion


@dataclass(frozen=True, kw_only=True)
class MovingWorld:
    """N environments at a moment each.

    `still`: fields of what never moves; `movers`: all else, there and then. `newest`: fields whose geodesic distance
    counts, and the row (N,) of each environment in them; None: that of what never moves.
    """

    still: FieldBank
    movers: Movers
    newest: tuple[FieldBank, Tensor] | None = None

    def sample(self, field: str, scene_ids: Tensor, p_W: Tensor) -> FieldSample:
        """As `FieldBank.sample`, of points (N, K, 3): exact distance and repulsion of movers, and the newest geodesic.

        Where a mover is nearer than all that stands still, it alone repels; the distance is the least of both.
        """
        margin_m = self.still.margin_m if FIELDS.index(field) else 0.0
        calm = self.still.sample(field, scene_ids, p_W)
        pull = self.still.attraction(field, scene_ids, p_W).force_W
        near, slope_W = nearest_mover(self.movers, p_W)
        near = near - margin_m
        nearer = near < calm.signed_distance
        push = torch.where(nearer[..., None], repulsion(near, slope_W, self.still.params), calm.force_W - pull)
        geodesic = calm.geodesic
        if self.newest is not None:
            newest = self.newest[0].attraction(field, self.newest[1], p_W)
            pull, geodesic = newest.force_W, newest.geodesic
        return FieldSample(pull + push, torch.minimum(near, calm.signed_distance), geodesic)

    def signed_distance(self, scene_ids: Tensor, p_W: Tensor) -> Tensor:
        """Distance to all obstacles, (N,), (N, K, 3) in W [m] -> (N, K) [m]."""
        return torch.minimum(self.still.signed_distance(scene_ids, p_W), mover_distance(self.movers, p_W))

    def lowest_clearance(
        self, scene_ids: Tensor, xpos: Tensor, xmat: Tensor, spheres: Spheres, variant: Tensor
    ) -> Tensor:
        """Smallest gap between spheres on frames and all obstacles, as `FieldBank.lowest_clearance`."""
        still = self.still.lowest_clearance(scene_ids, xpos, xmat, spheres, variant)
        return torch.minimum(still, mover_clearance(self.movers, xpos, xmat, spheres, variant))
