"""Gap between obstacles and many spheres fixed to moving frames, the smallest of each environment: one compiled pass.

The hot loop of training: 500 spheres an environment and step. In torch their positions, distances and differences are
arrays of their own, each read and written once; here they stay in registers. `lowest_clearance_torch` holds the same
formulas for any torch device; a test keeps the two equal.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from hotice.compiled import compiled
from hotice.fields import torch_sample
from hotice.fields.sample import PARALLEL_FROM, _clamp, _distance
from hotice.fields.volumes import Volumes


@dataclass(frozen=True, kw_only=True)
class Spheres:
    """S spheres on frames, in M variants that differ in size.

    frame (S,) int64; centre (M, S, 3) [m] in it; radius (M, S) [m].
    """

    frame: Tensor
    centre: Tensor
    radius: Tensor


def _lowest_kernel(sdf, origin, shape, offset, h, ids, xpos, xmat, frame, centre, radius, variant, out):
    """Smallest gap of frames xpos (N, B, 3), xmat (N, B, 3, 3) in scenes ids (N,) into out (N,); variant (N,)."""
    inv_h = xpos.dtype.type(1.0) / xpos.dtype.type(h)
    for n in numba.prange(xpos.shape[0]):
        s, m = ids[n], variant[n]
        nx, ny, nz = shape[s, 0], shape[s, 1], shape[s, 2]
        start, ox, oy, oz = offset[s], origin[s, 0], origin[s, 1], origin[s, 2]
        lowest = xpos.dtype.type(np.inf)
        for q in range(frame.shape[0]):
            b = frame[q]
            x, y, z = centre[m, q, 0], centre[m, q, 1], centre[m, q, 2]
            px = xpos[n, b, 0] + (xmat[n, b, 0, 0] * x + xmat[n, b, 0, 1] * y + xmat[n, b, 0, 2] * z)
            py = xpos[n, b, 1] + (xmat[n, b, 1, 0] * x + xmat[n, b, 1, 1] * y + xmat[n, b, 1, 2] * z)
            pz = xpos[n, b, 2] + (xmat[n, b, 2, 0] * x + xmat[n, b, 2, 1] * y + xmat[n, b, 2, 2] * z)
            ux, uy, uz = _clamp((px - ox) * inv_h, nx), _clamp((py - oy) * inv_h, ny), _clamp((pz - oz) * inv_h, nz)
            gap = _distance(sdf, start, nx, ny, nz, ux, uy, uz) - radius[m, q]
            if gap < lowest or gap != gap:  # NaN stays
                lowest = gap
        out[n] = lowest


_one: Any = compiled(nogil=True, error_model="numpy")(_lowest_kernel)
_many: Any = compiled(nogil=True, error_model="numpy", parallel=True)(_lowest_kernel)


def lowest_clearance(
    volumes: Volumes,
    ids: NDArray[np.int64],
    xpos: NDArray[np.float32],
    xmat: NDArray[np.float32],
    spheres: Spheres,
    variant: NDArray[np.int64],
    out: NDArray[np.float32],
) -> None:
    """Smallest distance of any sphere to the obstacles, negative where one intrudes, written into out (N,) [m].

    Args:
        volumes, ids (N,): fields and the scene of each environment.
        xpos (N, B, 3), xmat (N, B, 3, 3): frames in W.
        spheres, variant (N,): which of their variants each environment has.
        out: (N,).
    """
    many = len(ids) * len(spheres.frame) >= PARALLEL_FROM
    v = volumes
    (_many if many else _one)(
        v.sdf,
        v.origin,
        v.shape,
        v.offset,
        v.resolution_m,
        ids,
        xpos,
        xmat,
        spheres.frame.numpy(),
        spheres.centre.numpy(),
        spheres.radius.numpy(),
        variant,
        out,
    )


def lowest_clearance_torch(
    volumes: torch_sample.TorchVolumes, ids: Tensor, xpos: Tensor, xmat: Tensor, spheres: Spheres, variant: Tensor
) -> Tensor:
    """The same in torch, (N,) [m]."""
    frame, rows = spheres.frame, slice(None) if len(spheres.radius) == 1 else variant
    centre, radius = spheres.centre[rows], spheres.radius[rows]
    p_W = xpos[:, frame] + (xmat[:, frame] @ centre[..., None]).squeeze(-1)
    return (torch_sample.sample_distance(volumes, ids, p_W) - radius).amin(dim=-1)
