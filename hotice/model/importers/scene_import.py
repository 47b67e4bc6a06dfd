"""A scene from a point cloud or mesh: find the floor, stand it level, crop, clean, and cover what is solid by boxes."""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import cast

import numpy as np
from numpy.typing import NDArray

from hotice.errors import HoticeError, InvalidMap
from hotice.files import read_bytes
from hotice.model.frames import quat_from_axis_angle, quat_to_mat
from hotice.model.importers.bodies import rooms_and_solids
from hotice.model.importers.floor import Floor, fit_floor
from hotice.model.importers.formats import ply
from hotice.model.importers.formats.octomap import read_octomap
from hotice.model.importers.formats.pcd import read_pcd
from hotice.model.importers.map_obstacles import MAX_BAND_M, bounds_of, boxes_of, meshes_of
from hotice.model.importers.meshes import MESH_SUFFIXES, read_triangles, sample_surface
from hotice.model.importers.options import FAR_M, ImportOptions
from hotice.model.importers.upright import TURNED, clearly_upright, fit_upright
from hotice.model.scene import Obstacle, Scene
from hotice.model.source import MapSource

Points = NDArray[np.float64]
CLOUD_SUFFIXES = (".pcd", ".bt")
MAX_MAP_BYTES = 2 * 2**30
NEAR_M, STOREYS_M = 6.0, 50.0
"""The floor is fitted to what lies within this distance of start and goal, and of the middle height there, so that
ramps, other storeys and strays do not count."""
ALTITUDE_M = 10.0
"""A map whose points lie higher is turned about a place among them, not about its origin."""
RESOLVED_M = 0.005
MARGIN_M, HEIGHT_M = 1.0, 1.5
"""Default crop: this far beyond start and goal, and this high."""
FLOOR_CELL_M, FLOOR_SHARE = 0.2, 0.9
"""A scene without obstacles is believed where so many cells of its floor were seen."""
BELOW_M, BELOW_SHARE = 2.5, 0.2
"""Where more lies this far below the floor than above it, and that share of everything, the floor is none."""
_UP = {
    "x": [[0, 0, -1], [0, 1, 0], [1, 0, 0]],
    "-x": [[0, 0, 1], [0, 1, 0], [-1, 0, 0]],
    "y": [[1, 0, 0], [0, 0, -1], [0, 1, 0]],
    "-y": [[1, 0, 0], [0, 0, 1], [0, -1, 0]],
    "z": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
    "-z": [[1, 0, 0], [0, -1, 0], [0, 0, -1]],
}


@dataclass(frozen=True, kw_only=True)
class Imported:
    """A scene and what it was made of.

    `points_W` (n, 3) all points within the crop, `group` (n,) each KEPT, FLOOR or NOISE; `notes` what was found and
    left out, by name; `floor` of the map, which was turned upside down before where `upside_down`.
    """

    scene: Scene
    floor: Floor
    points_W: Points
    group: NDArray[np.int8]
    notes: dict[str, str]
    upside_down: bool = False


def import_scene(path: str | Path, options: ImportOptions) -> Imported:
    """Scene from a .pcd or .ply cloud, a .bt octree or an .obj, .stl, .off, .glb or .ply mesh.

    Its `source` says where it lies in the map.

    Raises `InputError`, `InvalidMap` or `InvalidScene`, each naming the file.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in (*CLOUD_SUFFIXES, *MESH_SUFFIXES):
        known = ", ".join((*CLOUD_SUFFIXES, *MESH_SUFFIXES))
        raise InvalidMap(f"{path}: format {path.suffix!r} is unknown: known are {known}")
    content = read_bytes(path, MAX_MAP_BYTES)
    R_MF = _turn(options, suffix)
    name = options.name or path.stem
    try:
        if suffix in CLOUD_SUFFIXES or suffix == ".ply" and not ply.read_header(content).faces:
            p_F, cell = _read_points(content, suffix, options.voxel_m / options.scale)
            p_M = options.scale * _resolved(p_F, options.scale) @ R_MF.T
            imported = from_points(p_M, options, name, options.scale * cell)
        else:
            corners = read_triangles(content, suffix)
            imported = from_triangles(options.scale * corners @ R_MF.T, options, name)
        floor = imported.floor
        source = MapSource.of(
            file=path.name,
            sha256=hashlib.sha256(content).hexdigest(),
            unit_m=options.scale,
            R_WM=floor.R_WM @ (TURNED if imported.upside_down else np.eye(3)) @ R_MF,
            position_m=floor.position_m,
        )
        return replace(imported, scene=replace(imported.scene, source=source))
    except HoticeError as error:
        raise type(error)(f"{path}: {error}") from None


def _read_points(content: bytes, suffix: str, spacing: float) -> tuple[Points, float]:
    """Points of a cloud (n, 3), or of an octree's cells at most `spacing` apart, and the edge of these cells, else 0.

    All in the file's unit.
    """
    if suffix == ".bt":
        return read_octomap(content, spacing)
    return (read_pcd(content) if suffix == ".pcd" else ply.read_ply(content)), 0.0


def from_points(p_M: Points, options: ImportOptions, name: str, cell_m: float = 0.0) -> Imported:
    """A scene from points (n, 3) in the map's frame [m], z roughly up. Raises `InvalidMap` or `InvalidScene`.

    With `up` auto, points that hang upside down are turned. `cell_m`: edge of the cells that the points fill, if they
    were counted in cells before: the floor is as thick as they are.
    """
    finite = p_M[np.isfinite(p_M).all(axis=1)]
    near = finite[_near(finite[None], options)]
    if len(near) < 100:
        raise InvalidMap(
            f"{len(p_M):,} points, {len(finite):,} of them finite and {len(near):,} within {NEAR_M:g} m of start and "
            "goal: at least 100 are needed there; check start, goal and unit"
        )
    origin = _origin(near, options)
    if options.floor == "given":
        floor = Floor.given()
    elif options.up != "auto":
        floor = fit_floor(near - origin)
    else:
        upside_down, floor = fit_upright(near - origin)
        if upside_down:
            return _turned_over(p_M, options, name, cell_m)
    floor = floor if options.floor == "given" else floor.among_cells(near - origin, cell_m)
    floor = floor.about(origin)
    start, goal, low, high = _crop(floor, options)
    near_W = floor.to_world(near)
    p_W = near_W[((near_W >= [*low[:2], -np.inf]) & (near_W < high)).all(axis=1)]
    if options.floor == "fit":
        _check_above(p_W, options)
    boxes, group = boxes_of(p_W, low, high, floor, options, (start[:2], goal), cell_m=cell_m)
    cells = f"of cells of {100 * cell_m:.3g} cm; nothing lower above the floor is kept" if cell_m else "as measured"
    notes = {
        "points": f"{len(p_M):,}, {len(p_M) - len(finite):,} not finite, {len(p_W):,} in the crop, {cells}",
        **_notes(floor, group, boxes),
    }
    if not boxes and not (_floor_is_seen(p_W, low, high) and clearly_upright(near_W)):
        raise InvalidMap(
            f"gives no obstacle: of {len(p_W):,} points in the crop none is more than floor or noise, and either that "
            "floor is not seen everywhere, or nothing about it shows that it is the floor and no ceiling; make the "
            "crop larger (--size-m), or check start, goal, unit and up axis"
        )
    scene = Scene(name, bounds_of(low, high), start, goal, tuple(boxes))
    return Imported(scene=scene, floor=floor, points_W=p_W, group=group, notes=notes)


def from_triangles(corners_M: NDArray[np.float64], options: ImportOptions, name: str) -> Imported:
    """A scene from triangles (F, 3, 3) in the map's frame [m], z roughly up. Raises `InvalidMap` or `InvalidScene`.

    Closed bodies stay exact meshes, also where they reach beyond the crop; those with too many faces, or with the floor
    in them, become boxes, inside as well. Of the rest, rooms included, the surface is sampled.
    """
    near = _near(corners_M.transpose(1, 0, 2), options)
    if not near.any():
        raise InvalidMap(f"no surface lies within {NEAR_M:g} m of start and goal: check them, and the unit")
    origin = _origin(corners_M[near].reshape(-1, 3), options)
    places = np.array([options.start[:2], options.goal])
    place = rooms_and_solids(corners_M - origin, near, places - origin[:2])
    if options.floor == "fit":
        low, high = _window(corners_M[near].reshape(-1, 3), options)
        floor = fit_floor(sample_surface(place.stood_on, 0.04, low - origin, high - origin))
    else:
        floor = Floor.given()
    surface = floor.to_world(place.surface)
    solids = [(floor.to_world(vertices), faces) for vertices, faces in place.solids]
    floor = floor.about(origin)
    start, goal, low, high = _crop(floor, options)
    meshes, boxed = meshes_of([body for body in solids if _touch(body[0][body[1]], low, high).any()], name)
    surface = np.concatenate([surface, *(vertices[faces] for vertices, faces in boxed)])
    p_W = sample_surface(surface, 0.5 * options.voxel_m, low - [0.0, 0.0, BELOW_M], high)
    boxes, group = boxes_of(p_W, low, high, floor, options, (start[:2], goal), boxed)
    if options.floor == "fit" and not meshes and not boxes:
        _check_above(p_W, options)
    notes = {
        "triangles": f"{len(corners_M):,}, {_touch(surface, low, high).sum():,} sampled in the crop",
        **_notes(floor, group, boxes),
        "meshes": f"{len(meshes)} closed bodies stay meshes",
    }
    scene = Scene(name, bounds_of(low, high), start, goal, (*meshes, *boxes))
    return Imported(scene=scene, floor=floor, points_W=p_W, group=group, notes=notes)


def _turn(options: ImportOptions, suffix: str) -> NDArray[np.float64]:
    """R_MF: from the file's axes to M's, z roughly up."""
    roll, pitch = np.radians(options.turn_deg)
    up = "y" if options.up == "auto" and suffix == ".glb" else options.up.replace("auto", "z")
    about_x, about_y = quat_from_axis_angle((1.0, 0.0, 0.0), roll), quat_from_axis_angle((0.0, 1.0, 0.0), pitch)
    turn = quat_to_mat(about_y) @ quat_to_mat(about_x) if roll or pitch else np.eye(3)
    return turn @ np.array(_UP[up], dtype=np.float64)


def _turned_over(p_M: Points, options: ImportOptions, name: str, cell_m: float) -> Imported:
    """The scene of an upside-down map, where start and goal mean the same either way up."""
    if any(v != 0.0 for v in (*options.start[1:], options.goal[1])):
        raise InvalidMap(
            "the map is upside down (its floor lies above its ceiling or has everything below it): add --up=-z, and "
            "give start and goal as they are after that, y and yaw with the other sign"
        )
    imported = from_points(p_M @ TURNED, replace(options, up="-z"), name, cell_m)
    up = "-z: the map is upside down and was turned over about its x axis (--up=z keeps it as it is)"
    return replace(imported, upside_down=True, notes={"up": up, **imported.notes})


def _resolved(p_F: Points, scale: float) -> Points:
    """The points, unless they were rounded to steps as large as obstacles. Raises `InvalidMap`."""
    finite = p_F[np.isfinite(p_F).all(axis=1)]
    if not len(finite):
        return p_F
    middle = np.abs(np.median(finite, axis=0)).max()
    step_m = scale * float(np.spacing(np.float32(min(middle, 1e30))))
    if step_m > RESOLVED_M and (finite[:10_000] == finite[:10_000].astype(np.float32)).all():
        raise InvalidMap(
            f"has 32-bit coordinates about {middle:,.0f}, which are {100 * step_m:.2g} cm apart: subtract an offset "
            "from the points before they are written with 32 bits"
        )
    return p_F


def _window(p: Points, options: ImportOptions) -> tuple[Points, Points]:
    """Lowest and highest corner of what counts, by the middle height of points (n, 3) about start and goal."""
    places = np.array([options.start[:2], options.goal])
    low, high = places.min(axis=0) - NEAR_M, places.max(axis=0) + NEAR_M
    about = ((p[:, :2] > low) & (p[:, :2] < high)).all(axis=1)
    given = options.floor == "given" or not about.any()
    middle = 0.0 if given else float(np.median(p[about, 2]))
    return np.array([*low, middle - STOREYS_M]), np.array([*high, middle + STOREYS_M])


def _near(corners: NDArray[np.float64], options: ImportOptions) -> NDArray[np.bool_]:
    """Mask of the things that reach into the window, (n,), given their corners (k, n, 3)."""
    low, high = _window(corners.reshape(-1, 3), options)
    return ((corners.max(axis=0) > low) & (corners.min(axis=0) < high)).all(axis=1)


def _touch(corners: NDArray[np.float64], low: Points, high: Points) -> NDArray[np.bool_]:
    """Mask of the triangles (F, 3, 3) that reach into a box, (F,)."""
    return ((corners.max(axis=1) >= low) & (corners.min(axis=1) <= high)).all(axis=1)


def _origin(near: Points, options: ImportOptions) -> Points:
    """Where the map is turned about, (3,): its origin, unless that is far from the points."""
    origin = np.zeros(3)
    if max(map(abs, (*options.start[:2], *options.goal))) > FAR_M:
        origin[:2] = np.round(options.start[:2])
    height = float(np.median(near[:, 2]))
    if options.floor == "fit" and abs(height) > ALTITUDE_M:
        origin[2] = round(height)
    return origin


def _check_above(p_W: Points, options: ImportOptions) -> None:
    """`InvalidMap` where the things near the floor are below it: the map is upside down, or this is a ceiling."""
    below, above = ((side * p_W[:, 2] > 0.1) & (side * p_W[:, 2] < BELOW_M) for side in (-1.0, 1.0))
    if below.sum() > max(above.sum(), BELOW_SHARE * len(p_W)):
        up = options.up.replace("auto", "z")
        other = up.removeprefix("-") if up.startswith("-") else f"-{up}"
        raise InvalidMap(
            f"{100 * below.sum() / len(p_W):.0f} % of the points lie below the floor and "
            f"{100 * above.sum() / len(p_W):.0f} % above it: is the map upside down? "
            f"Try --up={other}, or say that the floor is z = 0 already (--floor given)"
        )


def _floor_is_seen(p_W: Points, low: Points, high: Points) -> bool:
    """Whether points (n, 3) lie on nearly all of a crop's floor."""
    on_floor = p_W[np.abs(p_W[:, 2]) < MAX_BAND_M]
    edges = [np.arange(a, b + FLOOR_CELL_M, FLOOR_CELL_M) for a, b in zip(low[:2], high[:2], strict=True)]
    count = np.histogram2d(on_floor[:, 0], on_floor[:, 1], bins=edges)[0]
    return bool((count > 0).mean() >= FLOOR_SHARE)


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


def _notes(floor: Floor, group: NDArray[np.int8], boxes: list[Obstacle]) -> dict[str, str]:
    kept, on_floor, noise = np.bincount(group, minlength=3)[:3]
    height_m = floor.height_m + floor.origin_M[2]
    return {
        "floor": f"tilt {math.degrees(floor.tilt_rad):.2f} degrees, height {height_m:.3f} m in the map, "
        f"noise {1000 * floor.noise_m:.1f} mm",
        "crop": f"{kept:,} kept, {on_floor:,} floor or below it, {noise:,} noise and specks",
        "obstacles": f"{len(boxes)} boxes",
    }
