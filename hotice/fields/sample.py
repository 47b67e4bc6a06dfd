"""Trilinear sampling in compiled code, for numpy arrays and (without a copy) torch tensors on the CPU.

Inside the grid's box, half a cell beyond the outer nodes included, interpolation is exact on affine fields; points
outside take the value of the nearest point of the box. NaN positions give NaN. `torch_sample.py` holds the same
formulas for any torch device; a test keeps the two equal.

Inside the kernels positions are grid coordinates u = (p_W - origin) / h, so node i sits at u = i.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from hotice.compiled import compiled
from hotice.fields.potential import FieldParams, f_rep_scalar
from hotice.fields.volumes import SLOPE_STEP, Volumes

PARALLEL_FROM = 2_000
"""Fewer points than this run on one thread, where starting threads would cost more."""


@compiled(inline="always")
def _clamp(u, n):
    """Into the box [-0.5, n - 0.5]; NaN passes."""
    if u < -0.5:
        return -0.5
    return n - 0.5 if u > n - 0.5 else u


@compiled(inline="always")
def _lower(u, n):
    """Lower node of the cell that interpolates (or, in the outer half cells, extrapolates) u; 0 for NaN."""
    return min(int(u), n - 2) if u >= 0.0 else 0


@compiled(inline="always")
def _distance(sdf, start, nx, ny, nz, ux, uy, uz):
    """Trilinear signed distance; `start` is the flat index of the scene's first node."""
    i, j, k = _lower(ux, nx), _lower(uy, ny), _lower(uz, nz)
    fx, fy, fz = ux - i, uy - j, uz - k
    a = start + (i * ny + j) * nz + k
    b, c = a + nz, a + ny * nz
    d = c + nz
    v00 = sdf[a] + fz * (sdf[a + 1] - sdf[a])
    v01 = sdf[b] + fz * (sdf[b + 1] - sdf[b])
    v10 = sdf[c] + fz * (sdf[c + 1] - sdf[c])
    v11 = sdf[d] + fz * (sdf[d + 1] - sdf[d])
    v0 = v00 + fy * (v01 - v00)
    return v0 + fx * (v10 + fy * (v11 - v10) - v0)


def _distance_kernel(sdf, origin, shape, offset, h, ids, p, out):
    """Signed distance of points p (N, K, 3) in scenes ids (N,) into out (N, K)."""
    per_scene = p.shape[1]
    inv_h = p.dtype.type(1.0) / p.dtype.type(h)
    for m in numba.prange(p.shape[0] * per_scene):
        n, q = m // per_scene, m % per_scene
        s = ids[n]
        nx, ny, nz = shape[s, 0], shape[s, 1], shape[s, 2]
        ux = _clamp((p[n, q, 0] - origin[s, 0]) * inv_h, nx)
        uy = _clamp((p[n, q, 1] - origin[s, 1]) * inv_h, ny)
        uz = _clamp((p[n, q, 2] - origin[s, 2]) * inv_h, nz)
        out[n, q] = _distance(sdf, offset[s], nx, ny, nz, ux, uy, uz)


def _field_kernel(
    sdf, geo, step, origin, shape, offset, h, ids, p, margin, d0, eta, xi, s_min, force, distance, geodesic
):
    """F (eq. 3), inflated distance and geodesic distance of points p (N, K, 3) in scenes ids (N,), into the last three.

    F = -grad(U_att + U_rep) = -eta grad D_geo + f_rep(s) grad sdf: the first from nodes that hold the gradient, the
    second by differences of the signed distance over two cells.
    """
    per_scene = p.shape[1]
    inv_h = 1.0 / h
    for m in numba.prange(p.shape[0] * per_scene):
        n, q = m // per_scene, m % per_scene
        s = ids[n]
        start = offset[s]
        nx, ny, nz = shape[s, 0], shape[s, 1], shape[s, 2]
        ux = _clamp((p[n, q, 0] - origin[s, 0]) * inv_h, nx)
        uy = _clamp((p[n, q, 1] - origin[s, 1]) * inv_h, ny)
        uz = _clamp((p[n, q, 2] - origin[s, 2]) * inv_h, nz)
        i, j, k = _lower(ux, nx), _lower(uy, ny), _lower(uz, nz)
        fx, fy, fz = ux - i, uy - j, uz - k
        g, gx, gy, gz = 0.0, 0.0, 0.0, 0.0
        for corner in range(8):
            di, dj, dk = corner >> 2, corner >> 1 & 1, corner & 1
            w = (fx if di else 1.0 - fx) * (fy if dj else 1.0 - fy) * (fz if dk else 1.0 - fz)
            node = start + ((i + di) * ny + j + dj) * nz + k + dk
            g += w * geo[node, 0]
            gx += w * geo[node, 1]
            gy += w * geo[node, 2]
            gz += w * geo[node, 3]
        away = _distance(sdf, start, nx, ny, nz, ux, uy, uz) - margin
        pull = -eta * SLOPE_STEP
        gx, gy, gz = pull * gx, pull * gy, pull * gz
        if away < d0:
            push = f_rep_scalar(away, d0, xi, s_min) * inv_h
            high, low = _clamp(ux + 1.0, nx), _clamp(ux - 1.0, nx)
            rise = _distance(sdf, start, nx, ny, nz, high, uy, uz) - _distance(sdf, start, nx, ny, nz, low, uy, uz)
            gx += push * rise / (high - low)
            high, low = _clamp(uy + 1.0, ny), _clamp(uy - 1.0, ny)
            rise = _distance(sdf, start, nx, ny, nz, ux, high, uz) - _distance(sdf, start, nx, ny, nz, ux, low, uz)
            gy += push * rise / (high - low)
            high, low = _clamp(uz + 1.0, nz), _clamp(uz - 1.0, nz)
            rise = _distance(sdf, start, nx, ny, nz, ux, uy, high) - _distance(sdf, start, nx, ny, nz, ux, uy, low)
            gz += push * rise / (high - low)
        force[n, q, 0], force[n, q, 1], force[n, q, 2] = gx, gy, gz
        distance[n, q] = away
        geodesic[n, q] = g * step[s]


_distance_one: Any = compiled(nogil=True, error_model="numpy")(_distance_kernel)
_distance_many: Any = compiled(nogil=True, error_model="numpy", parallel=True)(_distance_kernel)
_field_one: Any = compiled(nogil=True, error_model="numpy")(_field_kernel)
_field_many: Any = compiled(nogil=True, error_model="numpy", parallel=True)(_field_kernel)


def sample_distance(volumes: Volumes, ids: NDArray[np.int64], p_W: NDArray[np.floating], out: NDArray) -> None:
    """Raw signed distance [m] of p_W (N, K, 3) in scenes ids (N,), written into out (N, K)."""
    kernel = _distance_many if out.size >= PARALLEL_FROM else _distance_one
    kernel(volumes.sdf, volumes.origin, volumes.shape, volumes.offset, volumes.resolution_m, ids, p_W, out)


def sample_field(
    volumes: Volumes,
    field: int,
    margin_m: float,
    params: FieldParams,
    ids: NDArray[np.int64],
    p_W: NDArray[np.floating],
    force_W: NDArray,
    distance: NDArray,
    geodesic: NDArray,
    *,
    repel: bool = True,
) -> None:
    """F (N, K, 3), distance to the inflated obstacles and finite geodesic distance (N, K) [m] at p_W (N, K, 3).

    Written into the last three arguments. `field`: index into `volumes.geo`, solved with `margin_m`; ids (N,).
    `repel`: False leaves out the repulsive force.
    """
    d0, *others = params.letters()
    kernel = _field_many if distance.size >= PARALLEL_FROM else _field_one
    v = volumes
    kernel(
        v.sdf,
        v.geo[field],
        v.step[:, field].copy(),
        v.origin,
        v.shape,
        v.offset,
        v.resolution_m,
        ids,
        p_W,
        margin_m,
        d0 if repel else -np.inf,
        *others,
        force_W,
        distance,
        geodesic,
    )
