"""Solids from the triangle meshes of furniture and walls, most of which are open.

Closed bodies stay meshes, or become the box that they are, exactly. A loose plane sheet gets a thickness, small holes
are filled where that closes a body, and everything else becomes the union of boxes over the voxels that its surface
passes, air that it encloses included. Voxels lie along the mesh's own axes and end at its bounding box, so a panel is
one layer and the outer size is exact; a surface inside moves by at most one voxel.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hotice.model.importers.meshes import sample_surface, split_bodies
from hotice.model.importers.voxels import cover_by_boxes, enclosed

Points = NDArray[np.float64]
Body = tuple[Points, NDArray[np.int64]]

VOXEL_M, COARSER = 0.03, 1.3
MAX_BOXES = 150
"""Voxels grow until no more boxes are needed."""
MAX_BODIES = 12
"""A mesh of more closed bodies becomes boxes: each body would be a file of its own."""
SHEET_M = 0.04
"""Thickness given to a plane sheet, half on each side."""
PLANE_M = 1e-3
THIN_M = 0.01


@dataclass(frozen=True, kw_only=True)
class Solid:
    """The union of closed `bodies` (vertices (V, 3), faces (F, 3)) and `boxes` (B, 2, 3), all in the mesh's frame [m].

    `how`: closed, thickened, repaired or boxed, the farthest that any part of it had to go.
    """

    bodies: tuple[Body, ...]
    boxes: Points
    how: str


def solidify(corners: Points, *, max_sheets: int = 1) -> Solid:
    """A solid of triangles (F, 3, 3) [m] that have area; what is not closed may be up to `max_sheets` plane sheets."""
    bodies, loose = split_bodies(corners)
    how = "closed"
    if len(loose):
        if plates := _plates(loose, max_sheets):
            how, added, loose = "thickened", plates, loose[:0]
        else:
            with np.errstate(invalid="ignore"):  # a filled sheet is a body without volume
                how, (added, loose) = "repaired", split_bodies(_patched(loose))
        bodies = [*bodies, *added]
    cuboid = [_is_box(body) for body in bodies]
    boxes = [np.array([v.min(axis=0), v.max(axis=0)]) for (v, _), is_box in zip(bodies, cuboid, strict=True) if is_box]
    bodies = [body for body, is_box in zip(bodies, cuboid, strict=True) if not is_box]
    if len(bodies) > MAX_BODIES:
        return boxed(corners)
    if len(loose):
        boxes, how = [*boxes, *boxed(loose).boxes], "boxed"
    return Solid(bodies=tuple(bodies), boxes=np.array(boxes).reshape(-1, 2, 3), how=how)


def _is_box(body: Body) -> bool:
    """Whether a closed body is the box round it, along the mesh's axes."""
    vertices, faces = body
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    volume = (a * np.cross(b, c)).sum() / 6.0
    return bool(np.isclose(volume, np.ptp(vertices, axis=0).prod(), rtol=1e-6, atol=0.0))


def _patched(corners: Points) -> Points:
    """The triangles, and those that close holes of three or four edges."""
    import trimesh

    vertices, faces = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    mesh = trimesh.Trimesh(vertices, faces.reshape(-1, 3), process=False)
    mesh.fill_holes()
    mesh.fix_normals(multibody=True)
    return np.asarray(mesh.triangles, dtype=np.float64)


def _plates(corners: Points, most: int) -> list[Body]:
    """Plates of the plane sheets that the triangles form; empty when they are more or anything else."""
    import trimesh

    vertices, faces = np.unique(corners.reshape(-1, 3).round(6), axis=0, return_inverse=True)
    mesh = trimesh.Trimesh(vertices, faces.reshape(-1, 3), process=False)
    flush = mesh.face_adjacency[mesh.face_adjacency_angles < 1e-3]
    label = trimesh.graph.connected_component_labels(flush, node_count=len(mesh.faces))
    if label.max() >= most:
        return []
    plates = [_thickened(corners[label == k]) for k in range(label.max() + 1)]
    closed = [plate for plate in plates if plate is not None]
    return closed if len(closed) == len(plates) else []


def _thickened(corners: Points) -> Body | None:
    """A plane sheet as a plate of `SHEET_M`: both faces and a rim along the border; None when it is none."""
    vertices, faces = np.unique(corners.reshape(-1, 3).round(6), axis=0, return_inverse=True)
    faces = faces.reshape(-1, 3)
    centre = vertices.mean(axis=0)
    normal = np.linalg.svd(vertices - centre, full_matrices=False)[2][-1]
    if np.abs((vertices - centre) @ normal).max() > PLANE_M:
        return None
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    faces = np.where((np.cross(b - a, c - a) @ normal > 0.0)[:, None], faces, faces[:, ::-1])
    faces = faces[np.unique(np.sort(faces, axis=1), axis=0, return_index=True)[1]]
    edges = np.concatenate([faces[:, [i, (i + 1) % 3]] for i in range(3)])
    _, first, count = np.unique(np.sort(edges, axis=1), axis=0, return_index=True, return_counts=True)
    rim, n = edges[first[count == 1]], len(vertices)
    walls = np.concatenate(
        [
            np.column_stack([rim[:, 1], rim[:, 0], rim[:, 0] + n]),
            np.column_stack([rim[:, 1], rim[:, 0] + n, rim[:, 1] + n]),
        ]
    )
    offset = 0.5 * SHEET_M * normal
    plate = np.concatenate([vertices + offset, vertices - offset]), np.concatenate([faces, faces[:, ::-1] + n, walls])
    return plate if _is_closed(*plate) else None


def _is_closed(vertices: Points, faces: NDArray[np.int64]) -> bool:
    import trimesh

    mesh = trimesh.Trimesh(vertices, faces, process=False)
    return bool(mesh.is_watertight and mesh.is_winding_consistent and mesh.volume > 0.0)


def boxed(corners: Points) -> Solid:
    """The voxels that the surface passes and encloses, as boxes."""
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    thin = np.maximum(THIN_M - (high - low), 0.0)
    low, high = low - 0.5 * thin, high + 0.5 * thin
    voxel = VOXEL_M
    while True:
        steps = np.round((high - low) / voxel).astype(int)
        points = sample_surface(corners, 0.5 * voxel, low - 1.0, high + 1.0)
        spacing = (high - low) / np.maximum(steps, 1)
        cell = np.floor((points - low) / spacing + np.where(steps > 0, 0.5, 0.0)).astype(int)
        solid = np.zeros(steps + 1, dtype=bool)
        solid[tuple(np.clip(cell, 0, steps).T)] = True
        boxes = cover_by_boxes(enclosed(solid))
        if len(boxes) <= MAX_BOXES:
            break
        voxel *= COARSER
    edges = [
        np.r_[lo, lo + (np.arange(n) + 0.5) * d, hi] for lo, hi, n, d in zip(low, high, steps, spacing, strict=True)
    ]
    ends = [[edges[k % 3][boxes[:, k]] for k in half] for half in ((0, 1, 2), (3, 4, 5))]
    return Solid(bodies=(), boxes=np.array(ends).transpose(2, 0, 1), how="boxed")
