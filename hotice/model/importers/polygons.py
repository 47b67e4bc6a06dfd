"""Triangles from face lists that may hold polygons of four or more corners."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Points = NDArray[np.float64]
Triangles = NDArray[np.int64]


def triangulated(faces: list, vertices: Points, normals: Points | None) -> tuple[Triangles, bool]:
    """Triangles (F, 3) of a face list, and whether it held larger polygons, which are fanned from their first corner.

    Args:
        faces: vertex indices, either one list per polygon or one flat list of triangles or of quads. A flat list whose
            length fits both is read as what agrees better with the normals, and as triangles when nothing speaks
            against it.
        vertices: (V, 3). normals: (V, 3) unit normals of the vertices, if known.

    Raises:
        ValueError: an index is no whole number or out of range, or a flat list fits neither.
    """
    if faces and isinstance(faces[0], list):
        polygons = [_indices(face, len(vertices)) for face in faces]
        triangles = [fan for polygon in polygons for fan in _fans(polygon[None])]
        return np.array(triangles, dtype=np.int64).reshape(-1, 3), any(len(p) > 3 for p in polygons)
    flat = _indices(faces, len(vertices))
    if len(flat) % 3 and len(flat) % 4:
        raise ValueError(f"{len(flat)} corners make neither triangles nor quads")
    if len(flat) % 4 or len(flat) % 3 == 0 and not _are_quads(flat, vertices, normals):
        return flat.reshape(-1, 3), False
    return _fans(flat.reshape(-1, 4)), True


def unit_normals(corners: Points) -> Points:
    """Normals of triangles (F, 3, 3) by the right-hand rule, (F, 3); not finite without an area."""
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    with np.errstate(invalid="ignore", divide="ignore"):
        return cross / np.linalg.norm(cross, axis=1, keepdims=True)


def _indices(face: list, count: int) -> Triangles:
    if not all(type(i) is int and 0 <= i < count for i in face):
        raise ValueError(f"a face holds something else than vertex numbers 0 to {count - 1}")
    return np.array(face, dtype=np.int64)


def _fans(polygons: Triangles) -> Triangles:
    """Polygons (P, n) of one number of corners -> triangles (P (n - 2), 3)."""
    first = np.repeat(polygons[:, :1], max(polygons.shape[1] - 2, 0), axis=1)
    return np.stack([first, polygons[:, 1:-1], polygons[:, 2:]], axis=-1).reshape(-1, 3)


def _are_quads(flat: Triangles, vertices: Points, normals: Points | None) -> bool:
    if len(flat) % 4 or normals is None or normals.shape != vertices.shape:
        return False
    return _agreement(_fans(flat.reshape(-1, 4)), vertices, normals) > 1e-6 + _agreement(
        flat.reshape(-1, 3), vertices, normals
    )


def _agreement(triangles: Triangles, vertices: Points, normals: Points) -> float:
    """Mean size of the cosine between the triangles' normals and those of their corners; no area counts as zero."""
    cosine = np.abs((unit_normals(vertices[triangles])[:, None] * normals[triangles]).sum(axis=-1))
    return float(np.nan_to_num(cosine, posinf=0.0).mean())
