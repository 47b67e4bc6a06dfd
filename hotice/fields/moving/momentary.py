"""Both fields at a moment of a scene in which something moves, in NumPy: for one robot, a station's or a real one.

The twin of `hotice.fields.moving.world.MovingWorld`, which is for many environments at once: distance and repulsion of
movers are those of their own shapes, ways to the goal those of what stands still, or of the newest build of all.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hotice.compiled import compiled
from hotice.fields.grid import Grid
from hotice.fields.hod_pf import GuidanceField, HodPf
from hotice.fields.potential import FieldParams, f_rep
from hotice.fields.solids import row_of, solid_distance, solid_normal
from hotice.model.scene import Obstacle, Scene

Array = NDArray[Any]
_NO_TREE = np.empty((0, 3, 3)), np.empty((0, 15))


class MomentaryField:
    """One field: that of what stands still, with movers, and, where it is given, the newest geodesic distance.

    Args:
        still: field of what never moves.
        movers: (M, 21) rows of what else is there now, see `hotice.fields.solids.Space`.
        newest: field whose geodesic distance counts; None: that of what never moves.
    """

    def __init__(self, still: GuidanceField, movers: Array, newest: GuidanceField | None = None) -> None:
        self._still, self._movers, self._newest = still, movers, newest
        self.margin_m, self.params = still.margin_m, still.params

    def query(self, p_W: Array) -> tuple[Array, Array, Array]:
        """F (..., 3), signed distance and geodesic distance (...) at positions (..., 3) in W [m], as `GuidanceField`.

        Where a mover is nearer than all that stands still, it alone repels; the distance is the least of both.
        """
        force_W, distance, geodesic = self._still.query(p_W)
        p = np.ascontiguousarray(p_W, dtype=np.float64).reshape(-1, 3)
        near, slope_W = _nearest(self._movers, *_NO_TREE, p)
        near, slope_W = near.reshape(distance.shape) - self.margin_m, slope_W.reshape(force_W.shape)
        nearer = near < distance
        if not nearer.any() and self._newest is None:
            return force_W, distance, geodesic
        pull_W, _, _ = self._still.attraction(p_W)
        push_W = np.where(nearer[..., None], f_rep(near, self.params)[..., None] * slope_W, force_W - pull_W)
        if self._newest is not None:
            pull_W, _, geodesic = self._newest.attraction(p_W)
        kind = force_W.dtype
        return (pull_W + push_W).astype(kind), np.minimum(near, distance).astype(kind), geodesic.astype(kind)


@dataclass(frozen=True, kw_only=True)
class MomentaryPf:
    """Both fields at a moment, for `hotice.policy.read_fields`; of their geodesic distances, see `MomentaryField`."""

    scene: Scene
    grid: Grid
    sgf: MomentaryField
    ogf: MomentaryField
    margin_m: float
    params: FieldParams


def momentary_pf(still: HodPf, movers: Sequence[Obstacle], newest: HodPf | None = None) -> MomentaryPf:
    """Fields of what never moves and of `movers`, boxes, cylinders, capsules and spheres, where they are now."""
    rows = np.array([row_of(o) for o in movers]).reshape(-1, 21)
    sgf, ogf = (
        MomentaryField(getattr(still, name), rows, None if newest is None else getattr(newest, name))
        for name in ("sgf", "ogf")
    )
    return MomentaryPf(
        scene=still.scene, grid=still.grid, sgf=sgf, ogf=ogf, margin_m=still.margin_m, params=still.params
    )


def moved(moving: Sequence[Obstacle], poses: Array) -> tuple[Obstacle, ...]:
    """Obstacles at other poses (M, 7): position [m] and quaternion wxyz in W; they stand still there."""
    return tuple(
        replace(o, position_m=tuple(row[:3]), quaternion_wxyz=tuple(row[3:]), motion=None)
        for o, row in zip(moving, np.asarray(poses, dtype=float).tolist(), strict=True)
    )


def poses_of(obstacles: Sequence[Obstacle]) -> Array:
    """Poses (M, 7) of obstacles: position [m] and quaternion wxyz in W."""
    return np.array([[*o.position_m, *o.quaternion_wxyz] for o in obstacles]).reshape(-1, 7)


@compiled(nogil=True, error_model="numpy")
def _nearest(solid, triangles, nodes, p):
    """Signed distance (K,) of points p (K, 3) to the nearest solid and its gradient (K, 3); inf where there is none."""
    least, slope = np.full(len(p), np.inf), np.zeros((len(p), 3))
    for k in range(len(p)):
        x, y, z = p[k, 0], p[k, 1], p[k, 2]
        which = -1
        for n in range(len(solid)):
            s = solid_distance(solid, triangles, nodes, n, x, y, z, np.inf, False)
            if s < least[k]:
                least[k], which = s, n
        if which >= 0:
            slope[k, 0], slope[k, 1], slope[k, 2] = solid_normal(solid, which, x, y, z)
    return least, slope
