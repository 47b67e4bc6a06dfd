"""Closed bodies of a place: those that are solid, and the room itself, inside which the robot walks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hotice.model.geometry import bvh
from hotice.model.importers.meshes import closed_bodies, upper_side

Points = NDArray[np.float64]
Body = tuple[Points, NDArray[np.int64]]
HEADROOM_M = 1.5
"""A body in which one can stand is at least this high inside."""


@dataclass(frozen=True, kw_only=True)
class Place:
    """Triangles (F, 3, 3) that are surfaces, loose or of rooms; closed `solids`; what may be floor of either."""

    surface: Points
    solids: list[Body]
    stood_on: Points


def rooms_and_solids(corners: Points, near: NDArray[np.bool_], places: Points) -> Place:
    """Meaning of triangles (F, 3, 3), z up, to a robot that walks between `places` (2, 2), start and goal.

    A body is taken whole, however far it reaches, when one of its triangles is `near` (F,); other triangles only if
    they are. A closed body that both places stand in is a room, a surface, unless it is a block with things on its top
    and none inside. Of rooms in one another, as the two sides of thick walls are, only the inner has the floor.
    """
    bodies, loose = closed_bodies(corners, near)
    solids, rooms = [], []
    for k, body in enumerate(bodies):
        room = _holds(body, places) and not _is_block(body, places, [*bodies[:k], *bodies[k + 1 :]], loose)
        (rooms if room else solids).append(body)
    rooms.sort(key=lambda room: _crossings(room[0][room[1]], *places[0])[0])
    surfaces = [loose, *(vertices[faces] for vertices, faces in rooms)]
    return Place(
        surface=np.concatenate(surfaces),
        solids=solids,
        stood_on=np.concatenate([loose, *surfaces[1:][-1:], *map(upper_side, solids)]),
    )


def inside(bodies: Sequence[Body], p: Points) -> NDArray[np.bool_]:
    """Whether points (n, 3) lie in one of the bodies, (n,)."""
    result = np.zeros(len(p), dtype=bool)
    for vertices, faces in bodies:
        low, high = vertices.min(axis=0), vertices.max(axis=0)
        near = np.flatnonzero(~result & ((p >= low) & (p <= high)).all(axis=1))
        if len(near):
            tree = bvh.Tree.of(vertices[faces])
            result[near] = bvh.signed_distances(*tree, np.ascontiguousarray(p[near])) < 0.0
    return result


def _holds(body: Body, places: Points) -> bool:
    """Whether each place (n, 2) has a point above it with `HEADROOM_M` inside the body."""
    vertices, faces = body
    for x, y in places:
        z = _crossings(vertices[faces], x, y)
        if len(z) < 2 or len(z) % 2 or np.diff(z)[::2].max() < HEADROOM_M:
            return False
    return True


def _crossings(corners: Points, x: float, y: float) -> NDArray[np.float64]:
    """Heights at which the vertical line through x, y crosses triangles (F, 3, 3), from low to high.

    The line is moved aside by a hair, so that it meets no edge.
    """
    x, y = x + 1.234567e-6, y + 2.345678e-6
    a, b, c = (corners[:, k] for k in range(3))
    sides = [
        (q[:, 0] - o[:, 0]) * (y - o[:, 1]) - (q[:, 1] - o[:, 1]) * (x - o[:, 0]) for o, q in ((b, c), (c, a), (a, b))
    ]
    weight = np.stack(sides, axis=1)
    hit = ((weight > 0.0).all(axis=1) | (weight < 0.0).all(axis=1)) & (np.abs(weight.sum(axis=1)) > 1e-12)
    share = weight[hit] / weight[hit].sum(axis=1, keepdims=True)
    return np.sort((share * corners[hit, :, 2]).sum(axis=1))


def _is_block(body: Body, places: Points, others: list[Body], loose: Points) -> bool:
    """Whether things stand on a closed body and none are inside it."""
    vertices, _ = body
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    things = [v.mean(axis=0) for v, _ in others] + list(loose.mean(axis=1)[:: max(1, len(loose) // 1000)])
    p = np.array(things).reshape(-1, 3)
    over = ((p[:, :2] > low[:2]) & (p[:, :2] < high[:2])).all(axis=1)
    top = max(_crossings(vertices[body[1]], x, y)[-1] for x, y in places)
    return bool((over & (p[:, 2] > top + 0.01)).any()) and not inside([body], p[over]).any()
