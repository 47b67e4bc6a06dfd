"""Humanoid-object decoupled potential fields of one scene (IV-A): SGF, and OGF about inflated obstacles."""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from hotice import checks
from hotice.checks import Range
from hotice.fields.defaults import MARGIN_M, RESOLUTION_M
from hotice.fields.grid import Grid
from hotice.fields.potential import FieldParams, u_rep
from hotice.fields.reachability import joins_start
from hotice.fields.sample import sample_field
from hotice.fields.volumes import SceneNodes, Volumes, arrange, solve_scene
from hotice.model.scene import Scene

if TYPE_CHECKING:
    import torch

    ArrayOrTensor = TypeVar("ArrayOrTensor", NDArray[Any], torch.Tensor)
else:
    ArrayOrTensor = TypeVar("ArrayOrTensor")

MAX_MARGIN_M = 1.0
_ALONE = np.zeros(1, dtype=np.int64)
"""Index of the only scene."""


class UnreachableGoalWarning(UserWarning):
    """Fields of a scene whose goal no free path reaches."""


class GuidanceField:
    """One field over one scene.

    Positions are (..., 3) in W [m], numpy or torch; results are of the same kind, dtype and device. Everything but
    `geodesic_distance` is finite for finite positions; outside the grid's box the nearest point of the box counts.
    Raises `ValueError` for positions whose last axis is not 3.
    """

    def __init__(
        self, volumes: Volumes, index: int, reached: NDArray[np.bool_], margin_m: float, params: FieldParams
    ) -> None:
        self._volumes = volumes
        self._index = index
        self._reached = reached
        self._torch: dict[str, Any] = {}
        self.margin_m = margin_m
        self.params = params

    def sample(self, p_W: ArrayOrTensor) -> ArrayOrTensor:
        """F = -grad(U_att + U_rep), (..., 3) -> (..., 3) (eq. 3): a speed in m/s when read as a command."""
        return self._query(p_W)[0]

    def potential(self, p_W: ArrayOrTensor) -> ArrayOrTensor:
        """U_att + U_rep, (..., 3) -> (...) (eqs. 1, 2); where no path leads, of the extended geodesic distance."""
        _, s, geodesic = self._query(p_W)
        return self.params.attraction * geodesic + u_rep(s, self.params)  # type: ignore

    def signed_distance(self, p_W: ArrayOrTensor) -> ArrayOrTensor:
        """To the field's own (inflated) obstacles, (..., 3) -> (...) [m], negative inside."""
        return self._query(p_W)[1]

    def geodesic_distance(self, p_W: ArrayOrTensor) -> ArrayOrTensor:
        """Length of the shortest free path to the goal, (..., 3) -> (...) [m]; inf inside obstacles and in pockets.

        Of a cell's free nodes those of the larger interpolation weight decide whether the point is reachable.
        """
        _, s, geodesic = self._query(p_W)
        reachable = self._reachable(np.asarray(_to_numpy(p_W), dtype=np.float64)) & (_to_numpy(s) > 0)
        if isinstance(geodesic, np.ndarray):
            return np.where(reachable | np.isnan(geodesic), geodesic, geodesic.dtype.type(np.inf))  # type: ignore
        import torch

        mask = torch.from_numpy(np.asarray(reachable)).to(geodesic.device)
        return geodesic.masked_fill(~(mask | geodesic.isnan()), math.inf)

    def extended_geodesic_distance(self, p_W: ArrayOrTensor) -> ArrayOrTensor:
        """As `geodesic_distance` where that is finite; elsewhere by way of the nearest reachable node, so finite."""
        return self._query(p_W)[2]

    def query(self, p_W: ArrayOrTensor) -> tuple[ArrayOrTensor, ArrayOrTensor, ArrayOrTensor]:
        """F, signed distance and extended geodesic distance at once, equal to what the three methods return."""
        return self._query(p_W)

    def attraction(self, p_W: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
        """As `query`, without the repulsive part of the force, -eta grad D_geo; of arrays alone."""
        return self._query_numpy(p_W, repel=False)

    def _query(self, p_W: ArrayOrTensor) -> tuple[ArrayOrTensor, ArrayOrTensor, ArrayOrTensor]:
        """(F, inflated distance, finite geodesic distance)."""
        if not isinstance(p_W, np.ndarray) and hasattr(p_W, "detach"):
            return self._query_torch(p_W)
        return self._query_numpy(p_W)  # type: ignore

    def _query_numpy(self, p_W: Any, repel: bool = True) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
        p: NDArray[Any] = np.asarray(p_W)
        if p.dtype not in (np.float32, np.float64):
            p = p.astype(np.float64)
        _check_last_axis(p.shape)
        lead = p.shape[:-1]
        flat = np.ascontiguousarray(p).reshape(1, -1, 3)
        number = flat.shape[1]
        force, away = np.empty((1, number, 3), p.dtype), np.empty((2, 1, number), p.dtype)
        if number:
            sample_field(
                self._volumes, self._index, self.margin_m, self.params, _ALONE, flat, force, *away, repel=repel
            )
        return force.reshape(p.shape), away[0].reshape(lead), away[1].reshape(lead)

    def _query_torch(self, p_W: Any) -> Any:
        import torch

        from hotice.fields import torch_sample

        _check_last_axis(tuple(p_W.shape))
        dtype = p_W.dtype if p_W.dtype in (torch.float32, torch.float64) else torch.float32
        volumes = self._torch.get(str(p_W.device))
        if volumes is None:
            volumes = self._torch[str(p_W.device)] = torch_sample.TorchVolumes.of(self._volumes, p_W.device)
        ids = torch.zeros(1, dtype=torch.int64, device=p_W.device)
        flat = p_W.to(dtype).reshape(1, -1, 3)
        out = torch_sample.sample_field(volumes, self._index, self.margin_m, self.params, ids, flat)
        out_dtype = p_W.dtype if p_W.dtype.is_floating_point else dtype
        shapes = (p_W.shape, p_W.shape[:-1], p_W.shape[:-1])
        return tuple(a.reshape(shape).to(out_dtype) for a, shape in zip(out, shapes, strict=True))

    def _reachable(self, p_W: NDArray[np.float64]) -> NDArray[np.bool_]:
        v = self._volumes
        shape = v.shape[0]
        u = np.clip(np.nan_to_num((p_W - v.origin[0]) / v.resolution_m), -0.5, shape - 0.5)
        low = np.clip(u.astype(np.int64), 0, shape - 2)
        balance = np.zeros(p_W.shape[:-1])
        for corner in np.ndindex(2, 2, 2):
            node = np.ravel_multi_index(tuple(np.moveaxis(low + corner, -1, 0)), tuple(shape))
            weight = np.where(corner, u - low, 1.0 - (u - low)).clip(0.0, 1.0).prod(axis=-1)
            free = v.sdf[node] > self.margin_m
            balance += weight * np.where(self._reached[node], 1.0, np.where(free, -1.0, 0.0))
        return balance > 0


@dataclass(frozen=True)
class HodPf:
    """`sgf` drives head, pelvis and feet; `ogf`, of obstacles inflated by `margin_m`, the object and the hands."""

    scene: Scene
    grid: Grid
    sgf: GuidanceField
    ogf: GuidanceField
    margin_m: float
    params: FieldParams


def check_margin(margin_m: object) -> float:
    """The margin as a float, or `InvalidConfig`."""
    return checks.number("margin_m", margin_m, Range(least=0, most=MAX_MARGIN_M, unit="m"))


def build_hod_pf(
    scene: Scene, resolution_m: float = RESOLUTION_M, margin_m: float = MARGIN_M, params: FieldParams | None = None
) -> HodPf:
    """Solves both fields of a scene.

    Warns `UnreachableGoalWarning` when no free path leads to the goal; the fields are finite there all the same. Raises
    `InvalidConfig` for a resolution or margin outside the allowed range.
    """
    margin_m = check_margin(margin_m)
    params = params or FieldParams()
    nodes = solve_scene(scene, resolution_m, (0.0, margin_m), threads=2)
    for margin, reached in zip((0.0, margin_m), nodes.reached, strict=True):
        if not joins_start(scene, nodes.grid, reached):
            message = f"scene {scene.name!r}: no path joins start and goal at margin {margin:g} m (see check_reachable)"
            warnings.warn(message, UnreachableGoalWarning, stacklevel=2)
    return hod_pf_of(scene, nodes, margin_m, params)


def hod_pf_of(scene: Scene, nodes: SceneNodes, margin_m: float, params: FieldParams) -> HodPf:
    """Both fields of nodes that were solved for the margins 0 and `margin_m`."""
    volumes = arrange([nodes.grid], [nodes.step], nodes.sdf, nodes.geo)
    sgf, ogf = (GuidanceField(volumes, i, nodes.reached[i], margin, params) for i, margin in enumerate((0.0, margin_m)))
    return HodPf(scene, nodes.grid, sgf, ogf, margin_m, params)


def _to_numpy(a: Any) -> NDArray[Any]:
    return a.detach().cpu().numpy() if hasattr(a, "detach") else np.asarray(a)


def _check_last_axis(shape: tuple[int, ...]) -> None:
    if not shape or shape[-1] != 3:
        raise ValueError(f"positions have shape {shape}: the last axis must hold x, y, z")
