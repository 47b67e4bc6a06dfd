"""Exact signed distance to watertight triangle meshes in compiled code.

Unsigned: closest point over all triangles, skipping clusters and triangles whose bounding balls lie farther than the
best so far. Sign: generalized winding number, asked only inside the bounding box and where the segment
from the previous point may have crossed the surface (it is longer than that point's distance).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numba
import numpy as np
from numpy.typing import NDArray

from hotice.errors import InvalidScene

MAX_FACES = 200_000
MAX_MESH_BYTES = 128 * 2**20
_LEAF = 16


@dataclass(frozen=True, eq=False)
class TriangleMesh:
    """`vertices` (V, 3) [m], `faces` (F, 3); `triangles` (F, 3, 3) sorted into clusters of `_LEAF` neighbours."""

    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]
    triangles: NDArray[np.float64]
    balls: NDArray[np.float64]
    clusters: NDArray[np.float64]

    @classmethod
    def of(cls, vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> TriangleMesh:
        """Sorts and bounds the triangles of a watertight mesh."""
        corners = vertices[faces]
        order = _sort_near(corners.mean(axis=1), np.arange(len(faces)))
        triangles = np.ascontiguousarray(corners[order])
        groups = [triangles[i : i + _LEAF].reshape(-1, 3) for i in range(0, len(triangles), _LEAF)]
        balls = np.array([_ball(t) for t in triangles])
        return cls(vertices, faces[order], triangles, balls, np.array([_ball(g) for g in groups]))

    @property
    def ball(self) -> tuple[NDArray[np.float64], float]:
        """Centre (3,) and radius of a ball that holds the mesh [m]."""
        ball = _ball(self.vertices)
        return ball[:3], float(ball[3])

    def signed_distance(self, p: NDArray[np.float64]) -> NDArray[np.float64]:
        """(..., 3) in the mesh's frame [m] -> (...) [m], negative inside."""
        flat = np.ascontiguousarray(p, dtype=np.float64).reshape(-1, 3)
        box = np.stack([self.vertices.min(axis=0), self.vertices.max(axis=0)])
        return _signed_distance(flat, self.triangles, self.balls, self.clusters, box).reshape(np.shape(p)[:-1])


def load_mesh(path: Path, scale: float) -> TriangleMesh:
    """A watertight mesh from file, scaled. Raises `InvalidScene` when it cannot be read, is too large or has holes."""
    try:
        stat = path.stat()
    except OSError as error:
        raise InvalidScene(f"mesh file {path} cannot be read: {error.strerror or error}") from None
    if stat.st_size > MAX_MESH_BYTES:
        raise InvalidScene(f"mesh file {path} is larger than {MAX_MESH_BYTES // 2**20} MiB: decimate it")
    return _load(path, scale, stat.st_mtime_ns, stat.st_size)


@lru_cache(maxsize=256)
def _load(path: Path, scale: float, _mtime: int, _size: int) -> TriangleMesh:
    import trimesh

    try:
        mesh = trimesh.load_mesh(str(path), process=True, skip_materials=True)
        if not isinstance(mesh, trimesh.Trimesh) or len(mesh.faces) == 0:
            raise ValueError("it holds no triangles")
    except Exception as error:  # any parser failure on an untrusted file is the file's
        reason = " ".join(str(error).split())[:200] or type(error).__name__
        raise InvalidScene(f"mesh file {path} cannot be read: {reason}") from None
    if len(mesh.faces) > MAX_FACES:
        raise InvalidScene(f"mesh file {path} has {len(mesh.faces):,} faces: decimate it to {MAX_FACES:,} at most")
    mesh.merge_vertices(merge_tex=True, merge_norm=True)
    mesh.update_faces(mesh.nondegenerate_faces())
    if not np.isfinite(mesh.vertices).all() or not mesh.is_watertight:
        raise InvalidScene(f"mesh file {path} is not watertight: close its holes (distance needs an inside)")
    if not mesh.is_winding_consistent:
        raise InvalidScene(f"mesh file {path} has faces that disagree on the outside: orient them consistently")
    return TriangleMesh.of(np.array(mesh.vertices, dtype=np.float64) * scale, np.array(mesh.faces, dtype=np.int64))


def _sort_near(centres: NDArray[np.float64], index: NDArray[np.int64]) -> NDArray[np.int64]:
    """Order in which neighbours in space follow each other: halving along the widest axis."""
    if len(index) <= _LEAF:
        return index
    part = centres[index]
    axis = int(np.argmax(np.ptp(part, axis=0)))
    half = _LEAF * max(1, round(len(index) / 2 / _LEAF))
    split = np.argpartition(part[:, axis], half)
    return np.concatenate([_sort_near(centres, index[split[:half]]), _sort_near(centres, index[split[half:]])])


def _ball(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Centre and radius, (4,), of a ball about the middle of the bounding box that holds the points (n, 3)."""
    centre = 0.5 * (points.min(axis=0) + points.max(axis=0))
    return np.append(centre, np.linalg.norm(points - centre, axis=1).max())


@numba.njit(cache=True, nogil=True)
def _signed_distance(p, triangles, balls, clusters, box):
    out = np.empty(len(p))
    sign = 1.0
    previous = -1.0
    for n in range(len(p)):
        x, y, z = p[n, 0], p[n, 1], p[n, 2]
        step = np.inf
        if n > 0:
            step = math.sqrt((x - p[n - 1, 0]) ** 2 + (y - p[n - 1, 1]) ** 2 + (z - p[n - 1, 2]) ** 2)
        best = (previous + step) * (1 + 1e-12) + 1e-12 if n > 0 else np.inf
        for c in range(len(clusters)):
            if _beyond(clusters[c], x, y, z, best):
                continue
            for t in range(c * _LEAF, min((c + 1) * _LEAF, len(triangles))):
                if not _beyond(balls[t], x, y, z, best):
                    best = min(best, _triangle_distance(triangles[t], x, y, z))
        if not (box[0, 0] < x < box[1, 0] and box[0, 1] < y < box[1, 1] and box[0, 2] < z < box[1, 2]):
            sign = 1.0
        elif not step < previous:
            sign = -1.0 if _inside(triangles, x, y, z) else 1.0
        previous = best
        out[n] = sign * best
    return out


@numba.njit(cache=True, inline="always")
def _beyond(ball, x, y, z, best):
    """Whether every point of the ball is farther than `best`."""
    reach = best + ball[3]
    return (x - ball[0]) ** 2 + (y - ball[1]) ** 2 + (z - ball[2]) ** 2 > reach * reach


@numba.njit(cache=True)
def _triangle_distance(tri, x, y, z):
    """Distance to a triangle: to its plane where the foot lies inside, else to the nearest edge."""
    ax, ay, az = tri[0]
    ux, uy, uz = tri[1, 0] - ax, tri[1, 1] - ay, tri[1, 2] - az
    vx, vy, vz = tri[2, 0] - ax, tri[2, 1] - ay, tri[2, 2] - az
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    wx, wy, wz = x - ax, y - ay, z - az
    nn = nx * nx + ny * ny + nz * nz
    if nn > 0.0:
        b = (nx * (uy * wz - uz * wy) + ny * (uz * wx - ux * wz) + nz * (ux * wy - uy * wx)) / nn
        c = (nx * (wy * vz - wz * vy) + ny * (wz * vx - wx * vz) + nz * (wx * vy - wy * vx)) / nn
        if b >= 0.0 and c >= 0.0 and b + c <= 1.0:
            return abs(nx * wx + ny * wy + nz * wz) / math.sqrt(nn)
    best = np.inf
    for i in range(3):
        j = (i + 1) % 3
        ex, ey, ez = tri[j, 0] - tri[i, 0], tri[j, 1] - tri[i, 1], tri[j, 2] - tri[i, 2]
        dx, dy, dz = x - tri[i, 0], y - tri[i, 1], z - tri[i, 2]
        ee = ex * ex + ey * ey + ez * ez
        s = min(max((dx * ex + dy * ey + dz * ez) / ee, 0.0), 1.0) if ee > 0.0 else 0.0
        best = min(best, (dx - s * ex) ** 2 + (dy - s * ey) ** 2 + (dz - s * ez) ** 2)
    return math.sqrt(best)


@numba.njit(cache=True)
def _inside(triangles, x, y, z):
    """Winding number about the point above one half in size (van Oosterom and Strackee's solid angles)."""
    total = 0.0
    for t in range(len(triangles)):
        ax, ay, az = triangles[t, 0, 0] - x, triangles[t, 0, 1] - y, triangles[t, 0, 2] - z
        bx, by, bz = triangles[t, 1, 0] - x, triangles[t, 1, 1] - y, triangles[t, 1, 2] - z
        cx, cy, cz = triangles[t, 2, 0] - x, triangles[t, 2, 1] - y, triangles[t, 2, 2] - z
        a = math.sqrt(ax * ax + ay * ay + az * az)
        b = math.sqrt(bx * bx + by * by + bz * bz)
        c = math.sqrt(cx * cx + cy * cy + cz * cz)
        triple = ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx)
        ab, bc, ca = ax * bx + ay * by + az * bz, bx * cx + by * cy + bz * cz, cx * ax + cy * ay + cz * az
        total += math.atan2(triple, a * b * c + ab * c + bc * a + ca * b)
    return abs(total) > math.pi
