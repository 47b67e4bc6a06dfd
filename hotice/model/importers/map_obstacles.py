"""Obstacles of a map that stands level: boxes of the voxels that its points fill, and closed bodies as meshes."""

from __future__ import annotations

import contextlib
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import cast

import numpy as np
from numpy.typing import NDArray

from hotice.errors import InvalidMap, InvalidScene
from hotice.model.geometry.extents import category_by_height
from hotice.model.geometry.shapes import MeshShape
from hotice.model.importers.bodies import Body, inside
from hotice.model.importers.box_obstacles import box_obstacles
from hotice.model.importers.floor import Floor
from hotice.model.importers.meshes import MAX_BODY_FACES, export_obj, upper_side
from hotice.model.importers.options import ImportOptions
from hotice.model.importers.voxels import Voxels, cover_by_boxes, occupied
from hotice.model.scene import COLUMN_HEIGHTS_M, Obstacle, Scene

Points = NDArray[np.float64]
MAX_BOXES = 2000
MIN_BAND_M, MAX_BAND_M = 0.015, 0.05
"""Points this near the floor are floor; in between it is three standard deviations of the noise about it."""
FLOOR_AREA_M2 = 0.5
"""A closed body with more than this to stand on in the floor's plane holds the floor and does not stay a mesh."""
STANDING_M = 0.12
"""Room that a robot takes at the least, about its middle."""
KEPT, FLOOR, NOISE = 0, 1, 2
_folders: list[contextlib.ExitStack] = []  # meshes of scenes not saved yet, kept until the program ends


def bounds_of(low: Points, high: Points) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    """Bounds of a scene from the lowest and highest corner of a crop (3,) [m]."""
    lowest, highest = np.round(low, 9).tolist(), np.round(high, 9).tolist()
    return tuple(lowest), tuple(highest)


def boxes_of(
    p_W: Points,
    low: Points,
    high: Points,
    floor: Floor,
    options: ImportOptions,
    places: Sequence[tuple[float, float]],
    bodies: Sequence[Body] | None = None,
    cell_m: float = 0.0,
) -> tuple[list[Obstacle], NDArray[np.int8]]:
    """Box obstacles of points (n, 3) in the crop, and the group of each point.

    With `bodies` the points are samples of a surface, all of which count, and the bodies are solid inside. At `places`,
    start and goal, the robot stands. `cell_m`: thickness of the floor beside its noise.
    """
    voxel_m = options.voxel_m
    band = max(cell_m, min(max(MIN_BAND_M, 3.0 * floor.noise_m), MAX_BAND_M))
    group = np.full(len(p_W), FLOOR, dtype=np.int8)
    above = np.flatnonzero(p_W[:, 2] > band)
    Scene("bounds", bounds_of(low, high), (*_middle(low, high), 0.0), _middle(low, high))  # refuses huge or empty crops
    voxels = Voxels.of(p_W[above], low, high, voxel_m)
    centre = np.stack(np.meshgrid(*map(np.arange, voxels.count.shape), indexing="ij"), axis=-1)
    centre = low + voxel_m * (centre + 0.5)
    stood_in = [_stood_in(centre, place) for place in places]
    if bodies is None:
        solid = occupied(voxels, options.min_points, options.min_voxels, stood_in=stood_in)
    else:
        full = inside(bodies, centre.reshape(-1, 3)).reshape(voxels.count.shape) & (centre[..., 2] > band)
        solid = occupied(voxels, 1, 1, full, stood_in)
    group[above] = np.where(voxels.holding(p_W[above], solid), KEPT, NOISE)
    boxes = cover_by_boxes(solid)
    if len(boxes) > MAX_BOXES:
        raise InvalidMap(
            f"needs {len(boxes):,} boxes of {voxel_m:g} m voxels, at most {MAX_BOXES:,} are allowed: "
            "make the crop smaller (--size-m) or the voxels larger (--voxel-m)"
        )
    return box_obstacles(solid, boxes, low, high, voxel_m, "box_{:04d}"), group


def _middle(low: Points, high: Points) -> tuple[float, float]:
    x, y = 0.5 * (low + high)[:2]
    return float(x), float(y)


def _stood_in(centre: Points, place: tuple[float, float]) -> NDArray[np.bool_]:
    """Voxels (nx, ny, nz), given their centres, that a robot at a place needs."""
    aside = np.hypot(*np.moveaxis(centre[..., :2] - place, -1, 0))
    return (aside < STANDING_M) & (centre[..., 2] > min(COLUMN_HEIGHTS_M)) & (centre[..., 2] < max(COLUMN_HEIGHTS_M))


def meshes_of(bodies: list[Body], name: str) -> tuple[list[Obstacle], list[Body]]:
    """Mesh obstacles of solid bodies, smallest first, and the bodies that cannot stay meshes."""
    meshes, boxed, budget = [], [], MAX_BODY_FACES
    with contextlib.ExitStack() as stack:
        folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="hotice-import-"))
        for vertices, faces in bodies:
            number = f"{name}_{len(meshes) + 1:03d}"
            if len(faces) > budget or _holds_floor(vertices, faces):
                boxed.append((vertices, faces))
                continue
            obstacle = _mesh_obstacle(Path(folder), number, vertices, faces)
            try:
                cast(MeshShape, obstacle.shape).mesh()
            except InvalidScene:  # closed, but with slivers or corners so close that a mesh obstacle is refused
                boxed.append((vertices, faces))
                continue
            meshes.append(obstacle)
            budget -= len(faces)
        if meshes:
            _folders.append(stack.pop_all())
    return meshes, boxed


def _holds_floor(vertices: Points, faces: NDArray[np.int64]) -> bool:
    if vertices[:, 2].max() <= MIN_BAND_M:
        return True
    top = upper_side((vertices, faces))
    flat = top[np.abs(top[:, :, 2]).max(axis=1) < MIN_BAND_M]
    cross = np.cross(flat[:, 1] - flat[:, 0], flat[:, 2] - flat[:, 0])
    return 0.5 * float(np.linalg.norm(cross, axis=1).sum()) > FLOOR_AREA_M2


def _mesh_obstacle(folder: Path, name: str, vertices: Points, faces: NDArray[np.int64]) -> Obstacle:
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    origin = np.round([*0.5 * (low + high)[:2], low[2]], 6)
    export_obj(folder / f"{name}.obj", vertices - origin, faces)
    return Obstacle(
        name, category_by_height(low[2], high[2]), MeshShape(f"{name}.obj", 1.0, folder), tuple(origin.tolist())
    )
