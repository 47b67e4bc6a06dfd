"""A scene from a point cloud or mesh: find the floor, stand it level, crop, clean, and cover what is solid by boxes."""

from __future__ import annotations

import math
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import cast

import numpy as np
from numpy.typing import NDArray

from hotice.errors import HoticeError, InvalidMap
from hotice.files import read_bytes
from hotice.model.extents import category_by_height
from hotice.model.importers import ply
from hotice.model.importers.floor import Floor, fit_floor
from hotice.model.importers.meshes import (
    MESH_SUFFIXES,
    export_obj,
    read_triangles,
    sample_surface,
    split_bodies,
    walkable,
)
from hotice.model.importers.options import ImportOptions
from hotice.model.importers.pcd import read_pcd
from hotice.model.importers.voxels import Voxels, column_extent, cover_by_boxes, occupied
from hotice.model.scene import Obstacle, Scene
from hotice.model.shapes import BoxShape, MeshShape

Points = NDArray[np.float64]
MAX_MAP_BYTES = 2 * 2**30
MAX_BOXES = 2000
NEAR_M = 6.0
"""The floor is fitted to what lies within this distance of start and goal, so that ramps and other storeys do not count."""
MARGIN_M, HEIGHT_M = 1.0, 1.5
"""Default crop: this far beyond start and goal, and this high."""
MIN_BAND_M, MAX_BAND_M = 0.015, 0.05
"""Points this near the floor are floor; in between it is three standard deviations of the noise about it."""
FLOOR_AREA_M2 = 0.5
"""A closed body with more than this in the floor's plane holds the floor and does not stay a mesh."""
KEPT, FLOOR, NOISE = 0, 1, 2
_UP = {
    "x": [[0, 0, -1], [0, 1, 0], [1, 0, 0]], "-x": [[0, 0, 1], [0, 1, 0], [-1, 0, 0]],
    "y": [[1, 0, 0], [0, 0, -1], [0, 1, 0]], "-y": [[1, 0, 0], [0, 0, 1], [0, -1, 0]],
    "z": [[1, 0, 0], [0, 1, 0], [0, 0, 1]], "-z": [[1, 0, 0], [0, -1, 0], [0, 0, -1]],
}  # fmt: skip
_folders: list[tempfile.TemporaryDirectory[str]] = []  # meshes of scenes not saved yet, kept until the program ends


@dataclass(frozen=True, kw_only=True)
class Imported:
    """A scene and what it was made of.

    `points_W` (n, 3) all points within the crop, `group` (n,) each KEPT, FLOOR or NOISE; `notes` what was found and left
    out, by name.
    """

    scene: Scene
    floor: Floor
    points_W: Points
    group: NDArray[np.int8]
    notes: dict[str, str]


def import_scene(path: str | Path, options: ImportOptions) -> Imported:
    """A scene from a .pcd or .ply cloud, or an .obj, .stl, .off, .glb or .ply mesh.

    Raises `InputError`, `InvalidMap` or `InvalidScene`, each naming the file.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix != ".pcd" and suffix not in MESH_SUFFIXES:
        raise InvalidMap(f"{path}: format {path.suffix!r} is unknown: known are .pcd, {', '.join(MESH_SUFFIXES)}")
    content = read_bytes(path, MAX_MAP_BYTES)
    turn = options.scale * np.array(
        _UP["y" if options.up == "auto" and suffix == ".glb" else options.up.replace("auto", "z")]
    )
    name = options.name or path.stem
    try:
        if suffix == ".pcd":
            return from_points(read_pcd(content) @ turn.T, options, name)
        if suffix == ".ply" and not ply.read_header(content).faces:
            return from_points(ply.read_ply(content) @ turn.T, options, name)
        return from_triangles(read_triangles(content, suffix) @ turn.T, options, name)
    except HoticeError as error:
        raise type(error)(f"{path}: {error}") from None


def from_points(p_M: Points, options: ImportOptions, name: str) -> Imported:
    """A scene from points (n, 3) in the map's frame [m], z roughly up. Raises `InvalidMap` or `InvalidScene`."""
    finite = p_M[np.isfinite(p_M).all(axis=1)]
    near = finite[_near(finite, options)]
    if len(near) < 100:
        raise InvalidMap(
            f"{len(p_M):,} points, {len(finite):,} of them finite and {len(near):,} within {NEAR_M:g} m of start and goal: "
            "at least 100 are needed there; check start, goal and unit"
        )
    floor = fit_floor(near) if options.floor == "fit" else Floor.given()
    start, goal, low, high = _crop(floor, options)
    p_W = floor.to_world(near)
    p_W = p_W[((p_W >= [*low[:2], -np.inf]) & (p_W < high)).all(axis=1)]
    boxes, group = _boxes(p_W, low, high, floor, options, noisy=True)
    notes = {
        "points": f"{len(p_M):,}, {len(p_M) - len(finite):,} not finite, {len(p_W):,} in the crop",
        **_notes(floor, group, boxes),
    }
    scene = Scene(name, _bounds(low, high), start, goal, tuple(boxes))
    return Imported(scene=scene, floor=floor, points_W=p_W, group=group, notes=notes)


def from_triangles(corners_M: NDArray[np.float64], options: ImportOptions, name: str) -> Imported:
    """A scene from triangles (F, 3, 3) in the map's frame [m], z roughly up. Raises `InvalidMap` or `InvalidScene`.

    Closed bodies without the floor in them stay exact meshes; of the rest the surface is sampled.
    """
    places = np.array([options.start[:2], options.goal])
    low, high = np.array([[*(places.min(axis=0) - NEAR_M), -50.0], [*(places.max(axis=0) + NEAR_M), 50.0]])
    near = corners_M[((corners_M.max(axis=1) >= low) & (corners_M.min(axis=1) <= high)).all(axis=1)]
    if not len(near):
        raise InvalidMap(f"no surface lies within {NEAR_M:g} m of start and goal: check them, and the unit")
    floor = fit_floor(sample_surface(walkable(near), 0.04, low, high)) if options.floor == "fit" else Floor.given()
    start, goal, low, high = _crop(floor, options)
    corners_W = floor.to_world(near)
    corners_W = corners_W[((corners_W.max(axis=1) >= low) & (corners_W.min(axis=1) <= high)).all(axis=1)]
    bodies, loose = split_bodies(corners_W) if len(corners_W) else ([], corners_W)
    folder = tempfile.TemporaryDirectory(prefix="hotice-import-")
    _folders.append(folder)
    kept = []
    for vertices, faces in bodies:
        if _holds_floor(vertices, faces):
            loose = np.concatenate([loose, vertices[faces]])
        else:
            kept.append(_mesh_obstacle(Path(folder.name), f"{name}_{len(kept) + 1:03d}", vertices, faces))
    p_W = sample_surface(loose, 0.5 * options.voxel_m, low - [0.0, 0.0, 1.0], high)
    boxes, group = _boxes(p_W, low, high, floor, options, noisy=False)
    notes = {"triangles": f"{len(corners_M):,}, {len(corners_W):,} in the crop", **_notes(floor, group, boxes)}
    notes["meshes"] = f"{len(kept)} closed bodies stay meshes"
    scene = Scene(name, _bounds(low, high), start, goal, (*kept, *boxes))
    return Imported(scene=scene, floor=floor, points_W=p_W, group=group, notes=notes)


def _near(p: Points, options: ImportOptions) -> NDArray[np.bool_]:
    places = np.array([options.start[:2], options.goal])
    low, high = places.min(axis=0) - NEAR_M, places.max(axis=0) + NEAR_M
    return ((p[:, :2] > low) & (p[:, :2] < high)).all(axis=1) & (np.abs(p[:, 2]) < 50.0)


def _crop(
    floor: Floor, options: ImportOptions
) -> tuple[tuple[float, float, float], tuple[float, float], Points, Points]:
    """Start, goal, and the lowest and highest corner of the crop, in W."""
    xy, goal = cast(tuple[float, float], options.start[:2]), options.goal
    yaw = options.start[2] if len(options.start) == 3 else math.atan2(goal[1] - xy[1], goal[0] - xy[0])
    start = (*xy, yaw)
    if options.frame == "map":
        start, goal = floor.place_to_world(xy, yaw), floor.place_to_world(goal)[:2]
    places = np.array([start[:2], goal])
    if options.size_m is None:
        low, high = places.min(axis=0) - MARGIN_M, places.max(axis=0) + MARGIN_M
        return start, goal, np.array([*low, 0.0]), np.array([*high, HEIGHT_M])
    half, middle = 0.5 * np.array(options.size_m[:2]), places.mean(axis=0)
    return start, goal, np.array([*(middle - half), 0.0]), np.array([*(middle + half), options.size_m[2]])


def _bounds(low: Points, high: Points) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    lowest, highest = np.round(low, 9).tolist(), np.round(high, 9).tolist()
    return tuple(lowest), tuple(highest)


def _boxes(
    p_W: Points, low: Points, high: Points, floor: Floor, options: ImportOptions, noisy: bool
) -> tuple[list[Obstacle], NDArray[np.int8]]:
    """Box obstacles of points (n, 3) in the crop, and the group of each point; without noise every point counts."""
    voxel_m = options.voxel_m
    band = min(max(MIN_BAND_M, 3.0 * floor.noise_m), MAX_BAND_M)
    group = np.full(len(p_W), FLOOR, dtype=np.int8)
    above = np.flatnonzero(p_W[:, 2] > band)
    Scene("bounds", _bounds(low, high), (*_middle(low, high), 0.0), _middle(low, high))  # refuses huge or empty crops
    voxels = Voxels.of(p_W[above], low, high, voxel_m)
    solid = occupied(voxels, options.min_points, options.min_voxels) if noisy else occupied(voxels, 1, 1)
    group[above] = np.where(voxels.holding(p_W[above], solid), KEPT, NOISE)
    boxes = cover_by_boxes(solid)
    if len(boxes) > MAX_BOXES:
        raise InvalidMap(
            f"needs {len(boxes):,} boxes of {voxel_m:g} m voxels, at most {MAX_BOXES:,} are allowed: "
            "make the crop smaller (--size-m) or the voxels larger (--voxel-m)"
        )
    obstacles = []
    for n, box in enumerate(boxes):
        first, last = low + voxel_m * box[:3], np.minimum(low + voxel_m * box[3:], high)
        kind = category_by_height(*(round(voxel_m * layer, 9) for layer in column_extent(solid, box)))
        size, centre = np.round(last - first, 6).tolist(), np.round(0.5 * (first + last), 6).tolist()
        obstacles.append(Obstacle(f"box_{n + 1:04d}", kind, BoxShape(tuple(size)), tuple(centre)))
    return obstacles, group


def _middle(low: Points, high: Points) -> tuple[float, float]:
    x, y = 0.5 * (low + high)[:2]
    return float(x), float(y)


def _holds_floor(vertices: Points, faces: NDArray[np.int64]) -> bool:
    if vertices[:, 2].max() <= MIN_BAND_M:
        return True
    corners = vertices[faces]
    flat = corners[np.abs(corners[:, :, 2]).max(axis=1) < MIN_BAND_M]
    cross = np.cross(flat[:, 1] - flat[:, 0], flat[:, 2] - flat[:, 0])
    return 0.5 * float(np.linalg.norm(cross, axis=1).sum()) > FLOOR_AREA_M2


def _mesh_obstacle(folder: Path, name: str, vertices: Points, faces: NDArray[np.int64]) -> Obstacle:
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    origin = np.round([*0.5 * (low + high)[:2], low[2]], 6)
    export_obj(folder / f"{name}.obj", vertices - origin, faces)
    return Obstacle(
        name, category_by_height(low[2], high[2]), MeshShape(f"{name}.obj", 1.0, folder), tuple(origin.tolist())
    )


def _notes(floor: Floor, group: NDArray[np.int8], boxes: list[Obstacle]) -> dict[str, str]:
    kept, on_floor, noise = np.bincount(group, minlength=3)[:3]
    return {
        "floor": f"tilt {math.degrees(floor.tilt_rad):.2f} degrees, height {floor.height_m:.3f} m in the map, "
        f"noise {1000 * floor.noise_m:.1f} mm",
        "crop": f"{kept:,} kept, {on_floor:,} floor or below it, {noise:,} noise and specks",
        "obstacles": f"{len(boxes)} boxes",
    }
