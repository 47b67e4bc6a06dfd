"""Exact distances to what moves, and the field with it: F = -grad(U_att + U_rep) where U_rep knows what moves.

The signed distance of the world is the least of the fields' grid, of what stands still, and of the movers' own, in
closed form. Where a mover is nearest, the repulsion of the field is that of the mover instead; attraction stays.
"""

from __future__ import annotations

import torch
from torch import Tensor

from hotice.fields.clearance import Spheres
from hotice.fields.moving.course import Movers
from hotice.fields.potential import FieldParams, f_rep
from hotice.fields.solids import BOX, CYLINDER

_TINY = 1e-9


def nearest_mover(movers: Movers, p_W: Tensor) -> tuple[Tensor, Tensor]:
    """Signed distance (N, K) [m] of points (N, K, 3) in W to the nearest mover, and its unit gradient (N, K, 3) in W.

    Infinite, with gradient zero, where there is none.
    """
    R_WB = movers.R_WB[:, None]
    p_B = ((p_W[:, :, None] - movers.p_W[:, None])[..., None, :] @ R_WB).squeeze(-2)
    s, slope_B = _distance(movers.kind[:, None], movers.size[:, None], p_B)
    s = torch.where(movers.there[:, None], s, torch.full_like(s, torch.inf))
    least, which = s.min(dim=2)
    pick = which[..., None, None].expand(-1, -1, 1, 3)
    slope_B = slope_B.gather(2, pick).squeeze(2)
    R = movers.R_WB.gather(1, which[..., None, None].expand(-1, -1, 3, 3))
    slope_W = (R @ slope_B[..., None]).squeeze(-1)
    return least, torch.where(torch.isfinite(least)[..., None], slope_W, torch.zeros_like(slope_W))


def mover_distance(movers: Movers, p_W: Tensor) -> Tensor:
    """Signed distance (N, K) [m] of points (N, K, 3) in W to the nearest mover; infinite where there is none."""
    return nearest_mover(movers, p_W)[0]


def mover_clearance(movers: Movers, xpos: Tensor, xmat: Tensor, spheres: Spheres, variant: Tensor) -> Tensor:
    """Smallest gap (N,) [m] between spheres on frames and movers, as `FieldBank.lowest_clearance`."""
    frame, rows = spheres.frame, slice(None) if len(spheres.radius) == 1 else variant
    centre, radius = spheres.centre[rows], spheres.radius[rows]
    p_W = xpos[:, frame] + (xmat[:, frame] @ centre[..., None]).squeeze(-1)
    return (mover_distance(movers, p_W) - radius).amin(dim=-1)


def repulsion(s: Tensor, slope_W: Tensor, params: FieldParams) -> Tensor:
    """-grad U_rep (N, K, 3) of distances s (N, K) [m] whose gradients are slope_W (N, K, 3); eq. 3."""
    far = torch.full_like(s, params.influence_distance_m)
    return f_rep(torch.minimum(s, far), params)[..., None] * slope_W


def _distance(kind: Tensor, size: Tensor, p: Tensor) -> tuple[Tensor, Tensor]:
    """Signed distance (...) and its gradient (..., 3) of points p (..., 3) in the frames of primitives.

    kind (...): `BOX`, `CYLINDER`, or a capsule, which a sphere is too; size (..., 3): see `hotice.fields.solids.Space`.
    """
    size = size.expand(p.shape)
    box = kind == BOX
    round_ = kind == CYLINDER
    radius, half = size[..., 0], size[..., 1]
    ring = torch.linalg.vector_norm(p[..., :2], dim=-1)
    # a cylinder is a rectangle in the plane of its axis
    flat_q = torch.stack([ring - radius, p[..., 2].abs() - half, torch.full_like(ring, -torch.inf)], dim=-1)
    q = torch.where(box[..., None], p.abs() - size, flat_q)
    most, axis = q.max(dim=-1)
    outside = q.clamp(min=0.0)
    away = torch.linalg.vector_norm(outside, dim=-1)
    flat = torch.where(most <= 0.0, most, away)
    inner = torch.nn.functional.one_hot(axis, 3).to(p.dtype)
    pull = torch.where((most <= 0.0)[..., None], inner, outside / away.clamp(min=_TINY)[..., None])
    sign = torch.where(p < 0.0, -1.0, 1.0)
    along_ring = p[..., :2] / ring.clamp(min=_TINY)[..., None]
    of_box = pull * sign
    of_cylinder = torch.cat([pull[..., :1] * along_ring, pull[..., 1:2] * sign[..., 2:]], dim=-1)
    beyond = p[..., 2] - torch.minimum(torch.maximum(p[..., 2], -half), half)
    arm = torch.cat([p[..., :2], beyond[..., None]], dim=-1)
    reach = torch.linalg.vector_norm(arm, dim=-1)
    of_capsule = arm / reach.clamp(min=_TINY)[..., None]
    capsule = ~(box | round_)
    s = torch.where(capsule, reach - radius, flat)
    slope = torch.where(capsule[..., None], of_capsule, torch.where(round_[..., None], of_cylinder, of_box))
    return s, slope
