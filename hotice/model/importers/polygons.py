"""Triangles from polygons: convex ones as a fan, others by cutting ears, so that a doorway in a wall stays open.

A polygon is looked at along its mean normal (Newell). What crosses itself there has no inside and is refused by number.
"""

from __future__ import annotations

import math
from itertools import chain

import numpy as np
from numpy.typing import NDArray

Points = NDArray[np.float64]
Indices = NDArray[np.int64]
MAX_CORNERS = 2000
_STRAIGHT_RAD = 1e-6
"""Corners that turn less are straight: an ear there would have no area."""


class BadPolygon(ValueError):
    """A polygon that cannot be filled; `number` counts from 0."""

    def __init__(self, number: int, reason: str) -> None:
        super().__init__(reason)
        self.number = int(number)


def fill(vertices: Points, polygons: list[list[int]]) -> Indices:
    """Triangles (F, 3) of polygons, each a list of vertex numbers; corners keep their order round the polygon.

    Polygons of fewer than three corners have no area and are left out.

    Raises:
        BadPolygon: a number is none of `vertices` (V, 3), or the polygon crosses itself or has too many corners.
    """
    counts = np.fromiter(map(len, polygons), np.int64, len(polygons))
    try:
        flat = np.fromiter(chain.from_iterable(polygons), np.int64, int(counts.sum()))
    except OverflowError:
        number = next(k for k, p in enumerate(polygons) if not all(abs(i) < 2**62 for i in p))
        raise BadPolygon(number, f"names a vertex far beyond the {len(vertices):,} there are") from None
    return fill_flat(vertices, flat, counts)


def fill_flat(vertices: Points, flat: Indices, counts: Indices) -> Indices:
    """`fill` of polygons that lie one after the other in `flat`, `counts` (P,) corners each."""
    first = np.concatenate([[0], np.cumsum(counts)])[:-1]
    wrong = np.flatnonzero((flat < 0) | (flat >= len(vertices)))
    if len(wrong):
        number = int(np.searchsorted(first, wrong[0], side="right")) - 1
        raise BadPolygon(number, f"names vertex {flat[wrong[0]]} (counted from 0) of {len(vertices):,}")
    parts, order = [np.empty((0, 3), np.int64)], [np.empty(0, np.int64)]
    for n in np.unique(counts[counts > 2]):
        which = np.flatnonzero(counts == n)
        corners = flat[first[which, None] + np.arange(n)]
        fans = _fans(corners)
        if n > 3:
            fannable = _may_be_fanned(vertices[corners])
            for k in np.flatnonzero(~fannable):
                fans[k] = corners[k][_cut(vertices[corners[k]], int(which[k]))]
        parts.append(fans.reshape(-1, 3))
        order.append(np.repeat(which, n - 2))
    return np.concatenate(parts)[np.argsort(np.concatenate(order), kind="stable")]


def _fans(polygons: Indices) -> Indices:
    """Polygons (P, n) of one number of corners -> triangles (P, n - 2, 3) from the first corner of each."""
    first = np.repeat(polygons[:, :1], max(polygons.shape[1] - 2, 0), axis=1)
    return np.stack([first, polygons[:, 1:-1], polygons[:, 2:]], axis=-1)


def _may_be_fanned(corners: Points) -> NDArray[np.bool_]:
    """Mask of the polygons (P, n, 3) that are strictly convex, or without area or finite size to get wrong, (P,)."""
    with np.errstate(all="ignore"):
        turn = _turns(_flattened(corners))
        convex = (turn > _STRAIGHT_RAD).all(axis=1) & (np.abs(turn.sum(axis=1) - 2.0 * math.pi) < 1e-3)
        arm = corners - corners[:, :1]
        area = np.linalg.norm(np.cross(arm[:, 1:-1], arm[:, 2:]), axis=-1).max(axis=1)
        return convex | ~np.isfinite(corners).all(axis=(1, 2)) | ~(area > 1e-12 * (arm**2).sum(axis=-1).max(axis=1))


def _flattened(corners: Points) -> Points:
    """Polygons (P, n, 3) seen against their mean normal, about their first corner, (P, n, 2); area is positive."""
    arm = corners - corners[:, :1]
    normal = np.cross(arm, np.roll(arm, -1, axis=1)).sum(axis=1)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    aside = np.eye(3)[np.abs(normal).argmin(axis=-1)]
    u = np.cross(aside, normal)
    u /= np.linalg.norm(u, axis=-1, keepdims=True)
    return np.stack([np.einsum("pni,pi->pn", arm, axis) for axis in (u, np.cross(normal, u))], axis=-1)


def _turns(p: Points) -> Points:
    """Angle by which polygons (..., n, 2) turn at each corner, left positive, (..., n) [rad]."""
    into, out = p - np.roll(p, 1, axis=-2), np.roll(p, -1, axis=-2) - p
    cross = into[..., 0] * out[..., 1] - into[..., 1] * out[..., 0]
    return np.arctan2(cross, (into * out).sum(axis=-1))


def _cut(corners: Points, number: int) -> Indices:
    """Triangles (n - 2, 3) of one polygon (n, 3) by ears: those beside straight corners first, then the roundest."""
    if len(corners) > MAX_CORNERS:
        raise BadPolygon(number, f"has {len(corners):,} corners and is not convex: at most {MAX_CORNERS:,} are allowed")
    with np.errstate(invalid="ignore"):  # an even bow tie has no mean normal
        p = _flattened(corners[None])[0]
    if not np.isfinite(p).all() or _crosses_itself(p):
        raise BadPolygon(number, f"is a polygon of {len(corners)} corners that crosses itself: triangulate the mesh")
    ring, triangles = np.arange(len(p)), []
    while len(ring) > 3:
        turn = _turns(p[ring])
        straight = np.abs(turn) <= _STRAIGHT_RAD
        beside = np.roll(straight, 1) | np.roll(straight, -1)
        before, after = np.roll(ring, 1), np.roll(ring, -1)
        rank = np.where(turn > _STRAIGHT_RAD, _roundness(p[before], p[ring], p[after]) + 2.0 * beside, -np.inf)
        for k in np.argsort(-rank, kind="stable"):
            ear = np.array([before[k], ring[k], after[k]])
            if not np.isfinite(rank[k]):
                raise BadPolygon(number, f"is a polygon of {len(corners)} corners with no inside: triangulate the mesh")
            if not _blocked(p[ear], p[ring[turn <= _STRAIGHT_RAD]]):
                break
        else:
            raise BadPolygon(
                number, f"is a polygon of {len(corners)} corners that touches itself: triangulate the mesh"
            )
        triangles.append(ear)
        ring = np.delete(ring, k)
    return np.array([*triangles, ring])


def _roundness(a: Points, b: Points, c: Points) -> Points:
    """0 to 1: area of triangles over what equal sides of the same square sum would have, (n, 2) each -> (n,)."""
    u, v, w = b - a, c - b, a - c
    square = (u**2 + v**2 + w**2).sum(axis=-1)
    return 2.0 * math.sqrt(3.0) * np.abs(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]) / np.maximum(square, 1e-300)


def _blocked(ear: Points, others: Points) -> bool:
    """Whether a corner of the polygon lies in an ear (3, 2), its border included but not its corners."""
    inside = np.ones(len(others), dtype=bool)
    scale = np.abs(ear - ear[0]).max() ** 2
    for a, b in zip(ear, np.roll(ear, -1, axis=0), strict=True):
        inside &= (b[0] - a[0]) * (others[:, 1] - a[1]) - (b[1] - a[1]) * (others[:, 0] - a[0]) >= -1e-12 * scale
    inside &= (others[:, None] != ear).any(axis=-1).all(axis=-1)
    return bool(inside.any())


def _crosses_itself(p: Points) -> bool:
    """Whether two sides of a polygon (n, 2) cross between their ends; a polygon that turns round twice does."""
    q, scale = np.roll(p, -1, axis=0), np.abs(p - p[0]).max() ** 2

    def side(a: Points, b: Points, c: Points) -> Points:
        ab, ac = b - a, c - a
        value = ab[..., 0] * ac[..., 1] - ab[..., 1] * ac[..., 0]
        return np.where(np.abs(value) > 1e-12 * scale, np.sign(value), 0.0)

    for k in range(len(p) - 2):
        a, b, c, d = p[k], q[k], p[k + 2 :], q[k + 2 :]
        if ((side(a, b, c) * side(a, b, d) < 0.0) & (side(c, d, a) * side(c, d, b) < 0.0)).any():
            return True
    return False


def triangulated(faces: list, vertices: Points, normals: Points | None) -> tuple[Indices, bool]:
    """Triangles (F, 3) of a 3D-FRONT face list, and whether it held larger polygons.

    Args:
        faces: vertex indices, either one list per polygon or one flat list of triangles or of quads. A flat list whose
            length fits both is read as what agrees better with the normals, and as triangles when nothing speaks
            against it.
        vertices: (V, 3). normals: (V, 3) unit normals of the vertices, if known.

    Raises:
        ValueError: an index is no whole number or out of range, a flat list fits neither, or a polygon cannot be
            filled.
    """
    if faces and isinstance(faces[0], list):
        polygons = [_indices(face, len(vertices)) for face in faces]
        return fill(vertices, polygons), any(len(p) > 3 for p in polygons)
    flat = np.array(_indices(faces, len(vertices)), dtype=np.int64)
    if len(flat) % 3 and len(flat) % 4:
        raise ValueError(f"{len(flat)} corners make neither triangles nor quads")
    if len(flat) % 4 or len(flat) % 3 == 0 and not _are_quads(flat, vertices, normals):
        return flat.reshape(-1, 3), False
    return fill_flat(vertices, flat, np.full(len(flat) // 4, 4)), True


def unit_normals(corners: Points) -> Points:
    """Normals of triangles (F, 3, 3) by the right-hand rule, (F, 3); not finite without an area."""
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    with np.errstate(invalid="ignore", divide="ignore"):
        return cross / np.linalg.norm(cross, axis=1, keepdims=True)


def _indices(face: object, count: int) -> list[int]:
    if not isinstance(face, list) or not all(type(i) is int and 0 <= i < count for i in face):
        raise ValueError(f"a face holds something else than vertex numbers 0 to {count - 1}")
    return face


def _are_quads(flat: Indices, vertices: Points, normals: Points | None) -> bool:
    if len(flat) % 4 or normals is None or normals.shape != vertices.shape:
        return False
    return _agreement(_fans(flat.reshape(-1, 4)).reshape(-1, 3), vertices, normals) > 1e-6 + _agreement(
        flat.reshape(-1, 3), vertices, normals
    )


def _agreement(triangles: Indices, vertices: Points, normals: Points) -> float:
    """Mean size of the cosine between the triangles' normals and those of their corners; no area counts as zero."""
    cosine = np.abs((unit_normals(vertices[triangles])[:, None] * normals[triangles]).sum(axis=-1))
    return float(np.nan_to_num(cosine, posinf=0.0).mean())
