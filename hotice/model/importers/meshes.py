"""Triangle meshes of whole places: read, turned z up, sampled, and split into bodies.

A body that is closed can stay a mesh obstacle; everything else (open sheets, rooms with their floor) is sampled and
treated like a cloud of points.
"""

from __future__ import annotations

from pathlib import Path
from typing import cast

import numpy as np
from numpy.typing import NDArray

from hotice.errors import InvalidMap
from hotice.files import write_text
from hotice.model.importers.formats.mesh_files import read_mesh

Points = NDArray[np.float64]
Body = tuple[Points, NDArray[np.int64]]
MESH_SUFFIXES = (".glb", ".obj", ".off", ".ply", ".stl")
MAX_FACES = 5_000_000
FARTHEST = 1e8
"""Corners with larger coordinates are strays, in any unit."""
MAX_BODY_FACES = 4000
"""Faces of all bodies that stay meshes: what the simulator's exact collisions allow for one."""


def read_triangles(content: bytes, suffix: str) -> NDArray[np.float64]:
    """Corners (F, 3, 3) of all triangles of a mesh file, in the file's frame and unit; scene graphs are flattened.

    Triangles that are not finite or have no area are left out. Raises `InvalidMap` when no others are there.
    """
    vertices, faces = read_mesh(content, suffix)
    corners = vertices[faces]
    if len(corners) > MAX_FACES:
        raise InvalidMap(f"has {len(corners):,} faces: decimate it to {MAX_FACES:,} at most")
    with np.errstate(all="ignore"):
        area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
        corners = corners[np.isfinite(area) & (area > 0.0) & (np.abs(corners).max(axis=(1, 2)) < FARTHEST)]
    if not len(corners):
        raise InvalidMap("holds no triangles of finite size")
    return corners


def sample_surface(corners: NDArray[np.float64], spacing_m: float, low: Points, high: Points) -> Points:
    """Points on triangles (F, 3, 3) within the box low .. high, none farther than `spacing_m` from the next, (n, 3).

    Triangles are halved across their longest edge and dropped once outside the box, so that a floor of a kilometre
    costs no more than its part in the box.
    """
    done = []
    while len(corners):
        corners = corners[((corners.max(axis=1) >= low) & (corners.min(axis=1) <= high)).all(axis=1)]
        edge = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2)
        small = edge.max(axis=1) <= spacing_m
        done.append(corners[small].mean(axis=1))
        corners, longest = corners[~small], edge[~small].argmax(axis=1)
        a, b, c = (np.take_along_axis(corners, (longest + k)[:, None, None] % 3, axis=1)[:, 0] for k in range(3))
        middle = 0.5 * (a + b)
        corners = np.concatenate([np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)])
    points = np.concatenate(done) if done else np.empty((0, 3))
    return points[((points >= low) & (points < high)).all(axis=1)]


def split_bodies(
    corners: NDArray[np.float64], max_faces: int = MAX_BODY_FACES
) -> tuple[list[Body], NDArray[np.float64]]:
    """Closed bodies, each vertices (V, 3) and faces (F, 3) counter-clockwise from outside, and all other triangles.

    Corners at the same place are one vertex. Bodies are taken from small to large while all together stay within
    `max_faces`.
    """
    return closed_bodies(corners, None, max_faces)


def closed_bodies(
    corners: NDArray[np.float64], near: NDArray[np.bool_] | None, max_faces: int | None = None
) -> tuple[list[Body], NDArray[np.float64]]:
    """`split_bodies` of what has a triangle `near` (F,); a body comes whole, of all others only the triangles near."""
    import trimesh

    near = np.ones(len(corners), dtype=bool) if near is None else near
    vertices, faces = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    mesh = trimesh.Trimesh(vertices, faces.reshape(-1, 3), process=False)
    label = trimesh.graph.connected_component_labels(mesh.face_adjacency, node_count=len(mesh.faces))
    size, wanted = np.bincount(label), np.bincount(label, near) > 0
    loose = near.copy()
    bodies, budget = [], len(corners) if max_faces is None else max_faces
    order = np.argsort(label, kind="stable")
    first = np.concatenate([[0], np.cumsum(size)])
    for k in np.argsort(size, kind="stable"):
        if size[k] > budget:
            break
        if size[k] < 4 or not wanted[k]:
            continue
        part = np.sort(order[first[k] : first[k + 1]])
        body = cast(trimesh.Trimesh, mesh.submesh([part], append=True, repair=False))
        if body.is_watertight and body.is_winding_consistent and abs(body.volume) > 1e-9:
            if body.volume < 0.0:
                body.invert()
            bodies.append((np.asarray(body.vertices, dtype=np.float64), np.asarray(body.faces, dtype=np.int64)))
            loose[part] = False
            budget -= size[k]
    return bodies, corners[loose]


def upper_side(body: Body) -> NDArray[np.float64]:
    """The triangles (F, 3, 3) of a solid body that look up: what one may stand on."""
    corners = body[0][body[1]]
    return corners[np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2] > 0.0]


def export_obj(path: Path, vertices: Points, faces: NDArray[np.int64]) -> None:
    """Writes a mesh as OBJ with full precision. Raises `OutputError`."""
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in vertices.tolist()]
    lines += [f"f {a} {b} {c}" for a, b, c in (faces + 1).tolist()]
    write_text(path, "\n".join(lines) + "\n")
