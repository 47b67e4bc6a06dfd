"""Triangles and outlines of the solids that replays draw, sized as MuJoCo sizes them.

box: half extents; sphere: radius; ellipsoid: semi-axes; capsule and cylinder: radius, half length along local z.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from hotice.model import Obstacle
from hotice.model.frames import quat_to_mat
from hotice.model.geometry.shapes import BoxShape, CapsuleShape, CylinderShape, MeshShape, SphereShape

Array = NDArray[np.float64]
SOLIDS = ("box", "capsule", "cylinder", "ellipsoid", "sphere")


@lru_cache(maxsize=512)
def triangles(kind: str, size: tuple[float, ...], segments: int = 16) -> tuple[Array, NDArray[np.int64]]:
    """Surface of a solid: vertices (V, 3) [m] in its own frame and faces (F, 3), counterclockwise seen from outside."""
    if kind == "box":
        return _box(np.array(size[:3]))
    arc = np.linspace(0.0, 0.5 * np.pi, segments // 4 + 1)
    if kind == "cylinder":
        r, h = size[:2]
        return _revolve(np.array([[0.0, h], [r, h], [r, -h], [0.0, -h]]), segments)
    if kind == "capsule":
        r, h = size[:2]
        cap = np.column_stack([r * np.sin(arc), h + r * np.cos(arc)])
        return _revolve(np.concatenate([cap, cap[::-1] * [1.0, -1.0]]), segments)
    if kind in ("sphere", "ellipsoid"):
        full = np.linspace(0.0, np.pi, segments // 2 + 1)
        vertices, faces = _revolve(np.column_stack([np.sin(full), np.cos(full)]), segments)
        axes = np.full(3, size[0]) if kind == "sphere" else np.array(size[:3])
        return vertices * axes, faces
    raise ValueError(f"unknown solid {kind!r}: known are {', '.join(SOLIDS)}")


def obstacle_geom(obstacle: Obstacle) -> tuple[str, tuple[float, ...]]:
    """Kind and MuJoCo size of an obstacle; ("mesh", ()) for meshes."""
    shape = obstacle.shape
    match shape:
        case BoxShape():
            return "box", tuple(0.5 * v for v in shape.size_m)
        case SphereShape():
            return "sphere", (shape.radius_m,)
        case CylinderShape() | CapsuleShape():
            return shape.type, (shape.radius_m, 0.5 * shape.length_m)
    return shape.type, ()


def obstacle_triangles(obstacle: Obstacle) -> tuple[Array, NDArray[np.int64]]:
    """Surface of an obstacle, any shape: vertices (V, 3) in the obstacle's frame [m] and faces (F, 3)."""
    kind, size = obstacle_geom(obstacle)
    if isinstance(obstacle.shape, MeshShape):
        mesh = obstacle.shape.mesh()
        return np.asarray(mesh.vertices, dtype=float), np.asarray(mesh.faces, dtype=int)
    return triangles(kind, size, 32)


COURSE_S = 0.2
"""Time from one place of a course to the next, where that is no more than `MOST_PLACES` of them."""
MOST_PLACES = 200


def course_of(obstacle: Obstacle) -> Array:
    """Places of an obstacle that moves, (n, 3) in W [m], from its first way point to its last."""
    assert obstacle.motion is not None
    first, last = obstacle.motion.knots_s[[0, -1]]
    count = int(np.clip(np.ceil((last - first) / COURSE_S), 1, MOST_PLACES - 1)) + 1
    return np.array([obstacle.at(float(time_s)).position_m for time_s in np.linspace(first, last, count)])


def placed(vertices: Array, position_W: Array, quat_W: Array) -> Array:
    """Vertices (V, 3) in a solid's frame -> (V, 3) in W."""
    return vertices @ quat_to_mat(quat_W).T + position_W


def outline(points: Array) -> Array:
    """Convex hull of points in a plane, (V, 2) -> (H, 2) counterclockwise; Andrew's monotone chain."""
    points = np.unique(np.round(points, 6), axis=0)
    if len(points) < 3:
        return points

    def chain(ordered: Array) -> list[Array]:
        hull: list[Array] = []
        for p in ordered:
            while len(hull) > 1 and _turn(hull[-2], hull[-1], p) <= 0:
                hull.pop()
            hull.append(p)
        # The last point begins the other chain.
        return hull[:-1]

    return np.array(chain(points) + chain(points[::-1]))


def _turn(a: Array, b: Array, c: Array) -> float:
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def _box(half: Array) -> tuple[Array, NDArray[np.int64]]:
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
    quads = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
    faces = [f for a, b, c, d in quads for f in ((a, b, c), (a, c, d))]
    return signs * half, np.array(faces)


def _revolve(profile: Array, segments: int) -> tuple[Array, NDArray[np.int64]]:
    """Turns a profile (P, 2) of (radius, height), from the top of the axis to its bottom, about z."""
    angle = np.linspace(0.0, 2.0 * np.pi, segments, endpoint=False)
    radius, height = profile[:, :1], profile[:, 1:]
    rings = np.stack(
        [radius * np.cos(angle), radius * np.sin(angle), np.broadcast_to(height, (len(profile), segments))], -1
    )
    a = np.arange(len(profile) - 1)[:, None] * segments + np.arange(segments)
    b = np.arange(len(profile) - 1)[:, None] * segments + (np.arange(segments) + 1) % segments
    faces = np.concatenate([np.stack([a, a + segments, b + segments], -1), np.stack([a, b + segments, b], -1)])
    vertices, faces = rings.reshape(-1, 3), faces.reshape(-1, 3)
    edges = vertices[faces]
    area = np.linalg.norm(np.cross(edges[:, 1] - edges[:, 0], edges[:, 2] - edges[:, 0]), axis=1)
    # Poles of the profile make triangles without area.
    return vertices, faces[area > 1e-12]
