"""Obstacles for compiled code: exact signed distance at any point, fast where a grid has been filled.

For each block of 4 x 4 x 4 nodes `Space` lists the obstacles that can be nearest to a point in it: distances change by
no more than the way, so an obstacle whose distance at the block's centre exceeds the least one by the block's diameter
never is.
"""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hotice.compiled import compiled
from hotice.fields.grid import Grid
from hotice.model.frames import quat_to_mat
from hotice.model.geometry import bvh
from hotice.model.geometry.shapes import BoxShape, CapsuleShape, CylinderShape, MeshShape, SphereShape
from hotice.model.scene import Obstacle, Scene

FAR_M = 10.0
BLOCK = 4
"""Nodes along a block's edge: index >> 2 is that of the block."""
BOX, CYLINDER, CAPSULE, MESH = range(4)
_ROUNDING = 1e-9
_BLOCK_REACH = 0.5 * math.sqrt(3.0) * (BLOCK + 1)
"""Radius in cells about a block's centre, with the outer half cells of the grid."""


class Space(NamedTuple):
    """Obstacles and a grid of (nx, ny, nz) nodes at (ox, oy, oz) + index h, flat because compiled code copies it often.

    `solid` (n, 21): per obstacle kind, size (3), R_WB (9), p_WB (3), bounding ball in W (4), root of its mesh; sizes
    are half extents of a box, (radius, half length) of a cylinder or capsule; a sphere is a capsule without length.
    `triangles`, `nodes`: see `bvh.Tree`. Nearest to a point in block b may be `member[start[b]:start[b + 1]]`.
    `sdf` (nx ny nz,): exact signed distance at the nodes, cut at FAR_M.
    """

    solid: NDArray[np.float64]
    triangles: NDArray[np.float64]
    nodes: NDArray[np.float64]
    start: NDArray[np.int64]
    member: NDArray[np.int64]
    sdf: NDArray[np.float64]
    ox: float
    oy: float
    oz: float
    h: float
    nx: int
    ny: int
    nz: int

    @classmethod
    def of(cls, scene: Scene, grid: Grid, threads: int = 1) -> Space:
        """Fills the grid, in slabs by so many threads. Raises `InvalidScene` for a mesh that cannot be used."""
        return cls.empty(scene, grid).filled(np.empty(grid.size), None, threads)

    @classmethod
    def empty(cls, scene: Scene, grid: Grid) -> Space:
        """All but `sdf`. Raises `InvalidScene` for a mesh that cannot be used."""
        meshes = list({o.shape: None for o in scene.obstacles if isinstance(o.shape, MeshShape)})
        tree, roots = bvh.Tree.join([m.mesh().tree for m in meshes])
        root_of: dict[Any, int] = dict(zip(meshes, roots, strict=True))
        solid = np.array([row_of(o, root_of.get(o.shape, 0)) for o in scene.obstacles]).reshape(-1, 21)
        ox, oy, oz = grid.origin.tolist()
        nx, ny, nz = grid.shape
        none, h = np.empty(0, dtype=np.int64), grid.resolution_m
        empty = cls(solid, tree.triangles, tree.nodes, none, none, np.empty(0), ox, oy, oz, h, nx, ny, nz)
        start, member = _block_members(empty)
        return empty._replace(start=start, member=member)

    def filled(self, sdf: NDArray[np.float64], stale: NDArray[np.bool_] | None, threads: int) -> Space:
        """Fills `sdf` (size,) in the blocks `stale` (blocks,), None: in all; that of others is right already."""
        stale = np.ones(len(self.start) - 1, np.bool_) if stale is None else stale
        full = self._replace(sdf=sdf)
        slabs = np.linspace(0, self.nx, threads + 1).astype(int).tolist()
        if threads > 1:
            with ThreadPoolExecutor(threads) as pool:
                list(pool.map(lambda first, last: _fill(full, stale, first, last), slabs[:-1], slabs[1:]))
        else:
            _fill(full, stale, 0, self.nx)
        return full

    def blocks_near(self, chosen: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Blocks (blocks,) for which one of the chosen obstacles (n,) can be the nearest."""
        block = np.repeat(np.arange(len(self.start) - 1), np.diff(self.start))
        near = np.zeros(len(self.start) - 1, np.bool_)
        near[block[chosen[self.member]]] = True
        return near


def row_of(obstacle: Obstacle, root: int = 0) -> list[float]:
    """An obstacle as a row of `Space.solid`; `root`: of a mesh."""
    kind, size = kind_and_size(obstacle.shape)
    centre, radius = obstacle.bounding_ball()
    R_WB = quat_to_mat(obstacle.quaternion_wxyz).reshape(-1)
    return [kind, *size, *R_WB.tolist(), *obstacle.position_m, *centre.tolist(), radius, root]


def kind_and_size(shape: Any) -> tuple[int, tuple[float, float, float]]:
    """Kind and size of a shape, as rows of `Space.solid` have them."""
    match shape:
        case BoxShape(size_m=(x, y, z)):
            return BOX, (0.5 * x, 0.5 * y, 0.5 * z)
        case CylinderShape(radius_m=radius, length_m=length):
            return CYLINDER, (radius, 0.5 * length, 0.0)
        case CapsuleShape(radius_m=radius, length_m=length):
            return CAPSULE, (radius, 0.5 * length, 0.0)
        case SphereShape(radius_m=radius):
            return CAPSULE, (radius, 0.0, 0.0)
        case MeshShape():
            return MESH, (0.0, 0.0, 0.0)
    raise TypeError(f"no compiled distance for {type(shape).__name__}")


@compiled(inline="always", error_model="numpy")
def turned(solid, n, x, y, z):
    """A direction in W, in the frame of obstacle n."""
    return (
        solid[n, 4] * x + solid[n, 7] * y + solid[n, 10] * z,
        solid[n, 5] * x + solid[n, 8] * y + solid[n, 11] * z,
        solid[n, 6] * x + solid[n, 9] * y + solid[n, 12] * z,
    )


@compiled(inline="always", error_model="numpy")
def seen(solid, n, x, y, z):
    """A point of W in the frame of obstacle n."""
    return turned(solid, n, x - solid[n, 13], y - solid[n, 14], z - solid[n, 15])


@compiled(inline="always", error_model="numpy")
def solid_distance(solid, triangles, nodes, n, x, y, z, bound, outside):
    """Exact signed distance of a point in W to obstacle n; of a mesh, `bound` when it is farther than that.

    `outside`: the point is known to lie outside, which spares a mesh the question.
    """
    bx, by, bz = seen(solid, n, x, y, z)
    kind = solid[n, 0]
    if kind == BOX:
        bx, by, bz = abs(bx) - solid[n, 1], abs(by) - solid[n, 2], abs(bz) - solid[n, 3]
        most = max(bx, by, bz)
        bx, by, bz = max(bx, 0.0), max(by, 0.0), max(bz, 0.0)
        d = most if most <= 0.0 else math.sqrt(bx * bx + by * by + bz * bz)
    elif kind == CAPSULE:
        bz = max(abs(bz) - solid[n, 2], 0.0)
        d = math.sqrt(bx * bx + by * by + bz * bz) - solid[n, 1]
    elif kind == CYLINDER:
        radial, axial = math.sqrt(bx * bx + by * by) - solid[n, 1], abs(bz) - solid[n, 2]
        most = max(radial, axial)
        radial, axial = max(radial, 0.0), max(axial, 0.0)
        d = most if most <= 0.0 else math.sqrt(radial * radial + axial * axial)
    else:
        d = bvh.closest(triangles, nodes, int(solid[n, 20]), bx, by, bz, bound)
        if not outside and d < bound and bvh.inside(triangles, nodes, int(solid[n, 20]), bx, by, bz):
            d = -d
    return d


@compiled(inline="always", error_model="numpy")
def ball_is_beyond(solid, n, x, y, z, best):
    """Whether all of obstacle n is certainly farther than `best` >= -radius, by its bounding ball."""
    dx, dy, dz, reach = x - solid[n, 16], y - solid[n, 17], z - solid[n, 18], best + solid[n, 19]
    return dx * dx + dy * dy + dz * dz > reach * reach


@compiled(nogil=True, error_model="numpy")
def _block_members(space):
    solid, h = space.solid, space.h
    bx, by, bz = _blocks(space.nx), _blocks(space.ny), _blocks(space.nz)
    count = len(solid)
    start = np.zeros(bx * by * bz + 1, np.int64)
    member = np.empty(max(4 * len(start), count), np.int64)
    distance = np.empty(count)
    reach = 2.0 * _BLOCK_REACH * h
    used = 0
    for block in range(bx * by * bz):
        i, j, k = block // (by * bz), block // bz % by, block % bz
        x = space.ox + (BLOCK * (i + 0.5) - 0.5) * h
        y = space.oy + (BLOCK * (j + 0.5) - 0.5) * h
        z = space.oz + (BLOCK * (k + 0.5) - 0.5) * h
        least = FAR_M
        for n in range(count):
            distance[n] = math.inf
            if not ball_is_beyond(solid, n, x, y, z, least + reach):
                distance[n] = solid_distance(solid, space.triangles, space.nodes, n, x, y, z, np.inf, False)
                least = min(least, distance[n])
        if used + count > len(member):
            member = np.concatenate((member, np.empty(len(member) + count, np.int64)))
        for n in range(count):
            if distance[n] <= least + reach:
                member[used] = n
                used += 1
        start[block + 1] = used
    return start, member[:used].copy()


@compiled(nogil=True, error_model="numpy")
def _fill(space, stale, first, last):
    """Sets `space.sdf` of nodes first <= i < last, in the blocks `stale` (blocks,)."""
    solid, triangles, nodes, start, member = space.solid, space.triangles, space.nodes, space.start, space.member
    by, bz = _blocks(space.ny), _blocks(space.nz)
    sdf = space.sdf
    node = first * space.ny * space.nz
    for i in range(first, last):
        for j in range(space.ny):
            for k in range(space.nz):
                block = ((i >> 2) * by + (j >> 2)) * bz + (k >> 2)
                if not stale[block]:
                    node += 1
                    continue
                x, y, z = space.ox + i * space.h, space.oy + j * space.h, space.oz + k * space.h
                near = sdf[node - 1] if k > 0 else FAR_M
                bound = _reach(near, space.h)
                sdf[node] = _nearest(
                    solid, triangles, nodes, start, member, block, x, y, z, bound, near > space.h and k > 0
                )
                node += 1


@compiled(inline="always", error_model="numpy")
def _blocks(n):
    return (n + BLOCK - 1) >> 2


@compiled(inline="always", error_model="numpy")
def _nearest(solid, triangles, nodes, start, member, block, x, y, z, bound, outside):
    """Least distance of a point to the members of its block, at most `bound` in size."""
    best = FAR_M
    for m in range(start[block], start[block + 1]):
        n = member[m]
        if best < 0.0 or not ball_is_beyond(solid, n, x, y, z, best):
            best = min(best, solid_distance(solid, triangles, nodes, n, x, y, z, bound, outside))
    return best


@compiled(inline="always", error_model="numpy")
def _index(u, n):
    return min(max(int(u + 0.5), 0), n - 1)


@compiled(nogil=True, error_model="numpy")
def distance_within(space, x, y, z, known=0.0, away=np.inf):
    """Exact signed distance of a point in the grid's box, cut at FAR_M.

    `known`: the distance of a point `away` from it.
    """
    per_m = 1.0 / space.h
    i = _index((x - space.ox) * per_m, space.nx)
    j = _index((y - space.oy) * per_m, space.ny)
    k = _index((z - space.oz) * per_m, space.nz)
    block = ((i >> 2) * _blocks(space.ny) + (j >> 2)) * _blocks(space.nz) + (k >> 2)
    dx, dy, dz = x - space.ox - i * space.h, y - space.oy - j * space.h, z - space.oz - k * space.h
    node_away = math.sqrt(dx * dx + dy * dy + dz * dz)
    near = space.sdf[(i * space.ny + j) * space.nz + k]
    bound = min(_reach(near, node_away), abs(known) + away + _ROUNDING)
    outside = near > node_away or known > away
    return _nearest(
        space.solid, space.triangles, space.nodes, space.start, space.member, block, x, y, z, bound, outside
    )


@compiled(inline="always", error_model="numpy")
def _reach(near, away):
    """Bound of the distance, in size, at a point `away` from one whose distance, cut at FAR_M, is `near`."""
    return abs(near) + away + _ROUNDING if near < FAR_M else np.inf


@compiled(nogil=True, error_model="numpy")
def convex_slope(solid, n, x, y, z, ux, uy, uz):
    """(s, s'): signed distance to convex obstacle n at a point of its own frame, and its slope along u."""
    kind = solid[n, 0]
    if kind == BOX:
        qx, qy, qz = abs(x) - solid[n, 1], abs(y) - solid[n, 2], abs(z) - solid[n, 3]
        vx, vy, vz = math.copysign(ux, ux * x), math.copysign(uy, uy * y), math.copysign(uz, uz * z)
        if qx <= 0.0 and qy <= 0.0 and qz <= 0.0:
            if qx >= qy and qx >= qz:
                return qx, vx
            return (qy, vy) if qy >= qz else (qz, vz)
        qx, qy, qz = max(qx, 0.0), max(qy, 0.0), max(qz, 0.0)
        s = math.sqrt(qx * qx + qy * qy + qz * qz)
        return s, (qx * vx + qy * vy + qz * vz) / s
    if kind == CAPSULE:
        z -= min(max(z, -solid[n, 2]), solid[n, 2])
        s = math.sqrt(x * x + y * y + z * z)
        return s - solid[n, 1], (x * ux + y * uy + z * uz) / max(s, 1e-12)
    r = math.sqrt(x * x + y * y)
    radial, axial = r - solid[n, 1], abs(z) - solid[n, 2]
    out, up = (x * ux + y * uy) / max(r, 1e-12), math.copysign(uz, uz * z)
    if radial <= 0.0 and axial <= 0.0:
        return (radial, out) if radial >= axial else (axial, up)
    radial, axial = max(radial, 0.0), max(axial, 0.0)
    s = math.sqrt(radial * radial + axial * axial)
    return s, (radial * out + axial * up) / s


@compiled(nogil=True, error_model="numpy")
def solid_normal(solid, n, x, y, z):
    """Unit gradient in W of the signed distance to convex obstacle n at a point in W."""
    bx, by, bz = seen(solid, n, x, y, z)
    gx = convex_slope(solid, n, bx, by, bz, 1.0, 0.0, 0.0)[1]
    gy = convex_slope(solid, n, bx, by, bz, 0.0, 1.0, 0.0)[1]
    gz = convex_slope(solid, n, bx, by, bz, 0.0, 0.0, 1.0)[1]
    return (
        solid[n, 4] * gx + solid[n, 5] * gy + solid[n, 6] * gz,
        solid[n, 7] * gx + solid[n, 8] * gy + solid[n, 9] * gz,
        solid[n, 10] * gx + solid[n, 11] * gy + solid[n, 12] * gz,
    )


@compiled(nogil=True, error_model="numpy")
def mesh_distance(space, n, x, y, z, known=0.0, away=np.inf):
    """Signed distance of a point to mesh n; that of a point `away` from it may be `known`."""
    bound = abs(known) + away + _ROUNDING
    return solid_distance(space.solid, space.triangles, space.nodes, n, x, y, z, bound, known > away)


@compiled(nogil=True, error_model="numpy")
def mesh_normal(space, n, x, y, z, s):
    """Unit gradient of the distance to mesh n, which is s here, by forward differences."""
    e = 1e-6
    gx = mesh_distance(space, n, x + e, y, z, s, e) - s
    gy = mesh_distance(space, n, x, y + e, z, s, e) - s
    gz = mesh_distance(space, n, x, y, z + e, s, e) - s
    size = max(math.sqrt(gx * gx + gy * gy + gz * gz), 1e-12)
    return gx / size, gy / size, gz / size


@compiled(nogil=True, error_model="numpy")
def normal_within(space, x, y, z):
    """Unit gradient of `distance_within`: of the obstacle nearest to a point in the grid's box."""
    i = _index((x - space.ox) / space.h, space.nx)
    j = _index((y - space.oy) / space.h, space.ny)
    k = _index((z - space.oz) / space.h, space.nz)
    block = ((i >> 2) * _blocks(space.ny) + (j >> 2)) * _blocks(space.nz) + (k >> 2)
    best, nearest = np.inf, -1
    for m in range(space.start[block], space.start[block + 1]):
        n = space.member[m]
        if best < 0.0 or not ball_is_beyond(space.solid, n, x, y, z, best):
            s = solid_distance(space.solid, space.triangles, space.nodes, n, x, y, z, np.inf, False)
            if s < best:
                best, nearest = s, n
    if nearest < 0:
        return 0.0, 0.0, 0.0
    if space.solid[nearest, 0] == MESH:
        return mesh_normal(space, nearest, x, y, z, best)
    return solid_normal(space.solid, nearest, x, y, z)
