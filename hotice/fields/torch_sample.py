"""The formulas of `sample.py` in torch, for any device; differentiable with respect to positions within a cell."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from hotice.fields.potential import FieldParams, f_rep
from hotice.fields.volumes import SLOPE_STEP, Volumes


@dataclass(frozen=True)
class TorchVolumes:
    """`Volumes` as tensors of one device, sharing memory on the CPU."""

    resolution_m: float
    origin: Tensor
    shape: Tensor
    offset: Tensor
    step: Tensor
    sdf: Tensor
    geo: tuple[Tensor, ...]

    @classmethod
    def of(cls, volumes: Volumes, device: torch.device | str = "cpu") -> TorchVolumes:
        """The tensors of `volumes` on a device."""
        origin, shape, offset, step, sdf, *geo = (
            torch.from_numpy(a).to(device)
            for a in (volumes.origin, volumes.shape, volumes.offset, volumes.step, volumes.sdf, *volumes.geo)
        )
        return cls(volumes.resolution_m, origin, shape, offset, step, sdf, tuple(geo))


def _grid_coordinates(v: TorchVolumes, ids: Tensor, p_W: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Coordinates u (N, K, 3) clamped to the box, shape (N, 1, 3) and first node (N, 1)."""
    shape = v.shape[ids][:, None]
    u = (p_W - v.origin[ids][:, None]) / v.resolution_m
    return _clamp(u, shape), shape, v.offset[ids][:, None]


def _clamp(u: Tensor, shape: Tensor) -> Tensor:
    return torch.minimum(u.clamp(min=-0.5), shape - 0.5)


def _corners(u: Tensor, shape: Tensor, first: Tensor) -> tuple[Tensor, Tensor]:
    """Flat indices and weights of the eight corners, (N, K, 8) each."""
    with torch.no_grad():
        low = torch.minimum(torch.nan_to_num(u).clamp(min=0.0).long(), shape - 2)
    f = u - low
    ny, nz = shape[..., 1], shape[..., 2]
    base = first + (low[..., 0] * ny + low[..., 1]) * nz + low[..., 2]
    index, weight = [], []
    for i in (0, 1):
        for j in (0, 1):
            for k in (0, 1):
                index.append(base + (i * ny + j) * nz + k)
                parts = [f[..., a] if c else 1.0 - f[..., a] for a, c in enumerate((i, j, k))]
                weight.append(parts[0] * parts[1] * parts[2])
    return torch.stack(index, dim=-1), torch.stack(weight, dim=-1)


def _distance(v: TorchVolumes, u: Tensor, shape: Tensor, first: Tensor) -> Tensor:
    index, weight = _corners(u, shape, first)
    return (v.sdf[index] * weight).sum(dim=-1)


def sample_distance(v: TorchVolumes, ids: Tensor, p_W: Tensor) -> Tensor:
    """Raw signed distance [m] of p_W (N, K, 3) in scenes ids (N,) -> (N, K)."""
    return _distance(v, *_grid_coordinates(v, ids, p_W))


def sample_field(
    v: TorchVolumes,
    field: int,
    margin_m: float,
    params: FieldParams,
    ids: Tensor,
    p_W: Tensor,
    *,
    repel: bool = True,
) -> tuple[Tensor, Tensor, Tensor]:
    """F (N, K, 3), distance to the inflated obstacles and finite geodesic distance (N, K) [m] at p_W (N, K, 3).

    F = -eta grad D_geo + f_rep(s) grad sdf (eq. 3), as in `hotice.fields.sample`; `repel`: False leaves out the second
    part.
    """
    u, shape, first = _grid_coordinates(v, ids, p_W)
    index, weight = _corners(u, shape, first)
    geo = (v.geo[field][index] * weight[..., None]).sum(dim=-2)
    distance = geo[..., 0] * v.step[ids, field][:, None]
    s = (v.sdf[index] * weight).sum(dim=-1) - margin_m
    pull = -params.attraction * SLOPE_STEP * geo[..., 1:]
    if not repel:
        return pull, s, distance
    slope = []
    for axis in range(3):
        step = torch.zeros(3, device=u.device, dtype=u.dtype)
        step[axis] = 1.0
        high, low = _clamp(u + step, shape), _clamp(u - step, shape)
        rise = _distance(v, high, shape, first) - _distance(v, low, shape, first)
        slope.append(rise / ((high - low)[..., axis] * v.resolution_m))
    force = f_rep(s, params)[..., None] * torch.stack(slope, dim=-1) - params.attraction * SLOPE_STEP * geo[..., 1:]
    return force, s, distance
