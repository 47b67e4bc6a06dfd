"""Scenes cropped from 3D-FRONT houses: solids of the furniture near a way, and ways that pass it."""

from __future__ import annotations

import re
import tempfile
import zlib
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import binary_dilation
from scipy.spatial import KDTree

from hotice.errors import InvalidConfig, InvalidScene
from hotice.files import make_folder
from hotice.model.frames import quat_rotate
from hotice.model.generate.crop import (
    CORRIDOR_M,
    OFF_LIMITS_M,
    RUN_M,
    SPACING_M,
    ClearanceMap,
    crop,
    propose_ways,
    why_blocked,
)
from hotice.model.geometry.extents import category_by_height
from hotice.model.geometry.lengths import LARGE_M
from hotice.model.geometry.shapes import BoxShape, MeshShape
from hotice.model.importers.front3d import Floor, Front3dReport, House, PlacedMesh, load_house
from hotice.model.importers.meshes import export_obj, sample_surface
from hotice.model.importers.options import Front3dConfig, Size
from hotice.model.importers.solids import MAX_BODIES, Solid, boxed, solidify
from hotice.model.scene import Obstacle, Scene, save_all
from hotice.model.source import MapSource
from hotice.progress import doing

TOUCHED_M = (0.03, 1.3)
"""Heights above the floor between which a robot touches things."""
FLUSH_M = 0.01
"""Height [m] above the floor up to which a thing is part of it."""
LEVEL_M = 0.05
"""Floors that differ less in height make one level."""
DOORWAY_M = 0.2
"""Floors grow by this, so that rooms join through the doorways in walls of 12 to 24 cm."""
SIZES_M = ((3.0, 10.0), (CORRIDOR_M, 10.0), (1.5, 3.0))
WAYS_PER_SCENE = 20
APART_M = 0.5
"""Two ways of a house differ by this at start or goal."""

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Front3dScenes:
    """Scenes of a house, what became of its parts, how their solids were made, and ways `rejected` by reason."""

    scenes: tuple[Scene, ...]
    report: Front3dReport
    solids: Mapping[str, int]
    rejected: Mapping[str, int]


class SolidHouse:
    """A house whose pieces become obstacles when a crop asks for them. Meshes are written to `folder`, once each.

    `solids` counts pieces by how their solid was made: closed, repaired, thickened or boxed (see `solids`).
    """

    def __init__(self, house: House, folder: str | Path) -> None:
        self.house = house
        self.folder = make_folder(folder)
        self.solids: Counter[str] = Counter()
        self._made: dict[PlacedMesh, list[Obstacle]] = {}
        self._extents = [(p.min(axis=(0, 1)), p.max(axis=(0, 1))) for p in (q.corners_H for q in house.pieces)]

    def obstacles(self, low: ArrayLike, high: ArrayLike, floor_m: float) -> list[Obstacle]:
        """Obstacles of pieces that reach into the box low .. high (3,) above a floor, with that floor at z = 0."""
        down = np.array([0.0, 0.0, floor_m])
        near = []
        for piece, (bottom, top) in zip(self.house.pieces, self._extents, strict=True):
            above = top[2] - floor_m > FLUSH_M
            if above and (bottom - down < np.asarray(high)).all() and (top - down > np.asarray(low)).all():
                category = category_by_height(bottom[2] - floor_m, top[2] - floor_m)
                near += [
                    Obstacle(o.name, category, o.shape, tuple((o.position_m - down).tolist()), o.quaternion_wxyz)
                    for o in self._obstacles_of(piece)
                ]
        return near

    def _obstacles_of(self, piece: PlacedMesh) -> list[Obstacle]:
        if piece not in self._made:
            solid = solidify(piece.corners, max_sheets=MAX_BODIES if piece.kind == "structure" else 1)
            try:
                meshes = self._meshes(piece, solid)
            except InvalidScene:  # closed, but with slivers or corners so close that a mesh obstacle is refused
                meshes, solid = [], boxed(piece.corners)
            self.solids[f"{piece.kind} {solid.how}"] += 1
            self._made[piece] = [*meshes, *_boxes(piece, solid)]
        return self._made[piece]

    def _meshes(self, piece: PlacedMesh, solid: Solid) -> list[Obstacle]:
        obstacles = []
        for number, (vertices, faces) in enumerate(solid.bodies, 1):
            name = f"{piece.name}_body_{number}"
            file = f"{_word(self.house.name)}_{name}.obj"
            export_obj(self.folder / file, vertices, faces)
            shape = MeshShape(file, folder=self.folder)
            try:
                shape.mesh()
            except InvalidScene:
                shape.path.unlink()
                raise
            obstacles.append(Obstacle(name, "side", shape, piece.position_m, piece.quaternion_wxyz))
        return obstacles


def crop_house(solids: SolidHouse, name: str, start: ArrayLike, goal: ArrayLike, size_m: Size = LARGE_M) -> Scene:
    """The scene round a way from start to goal, x, y in the house's frame [m], as `generate.crop.crop` lays it out.

    z = 0 is the floor below the start. Raises `InvalidScene` when start or goal is not on a floor, both are not on one
    level, or as `crop` does.
    """
    floors = [floor_below(solids.house, p) for p in (start, goal)]
    for what, p, floor in zip(("start", "goal"), (start, goal), floors, strict=True):
        if floor is None:
            raise InvalidScene(f"{what} {np.asarray(p).tolist()} is on no floor of house {solids.house.name!r}")
    below, beyond = (f.height_m for f in floors if f)
    if abs(below - beyond) > LEVEL_M:
        raise InvalidScene(f"start and goal are on floors at {below:.2f} m and {beyond:.2f} m: one level is needed")
    return crop(name, _near(solids, start, goal, size_m, below), start, goal, size_m, _source(solids.house, below))


def front3d_scenes(
    json_path: str | Path,
    models_folders: str | Path | Sequence[str | Path],
    folder: str | Path,
    *,
    count: int,
    seed: int = 0,
    size_m: Size = LARGE_M,
) -> Front3dScenes:
    """Up to `count` scenes of a house, `front3d_<house>_<number>`, whose ways pass furniture and can be crossed.

    Args:
        json_path: see `load_house`. models_folders: see `load_house`.
        folder: for the obstacles' mesh files; created once the house is read.
        count: scenes wanted; a small house may hold fewer different ways. seed: of the order in which ways are tried.
        size_m: of the crops, at least 3 m along the way.

    Raises:
        InputError, InvalidMap: see `load_house`. InvalidConfig: an argument is out of range.
    """
    fits = all(least <= side <= most for side, (least, most) in zip(size_m, SIZES_M, strict=True))
    if count < 1 or seed < 0 or not fits:
        raise InvalidConfig(
            f"{count} scenes of seed {seed} and size {size_m}: at least 1, of a seed of at least 0 and a size of "
            "3 to 10 m along the way, 2 to 10 m across and 1.5 to 3 m up, are allowed"
        )
    house = load_house(json_path, models_folders)
    solids, rejected = SolidHouse(house, folder), Counter[str]()
    rng = np.random.default_rng([seed, zlib.crc32(house.name.encode())])
    ways = [(level, way) for level in _levels(house) for way in propose_ways(level_clearance(house, level), rng)]
    scenes: list[Scene] = []
    taken: list[Array] = []
    for index in rng.permutation(len(ways)):
        if len(scenes) == count or rejected.total() >= WAYS_PER_SCENE * count:
            break
        level, way = ways[index]
        ends = np.array([way.start, way.goal])
        if way.length_m + RUN_M > size_m[0] + 1e-6 or any(
            np.linalg.norm(ends - t, axis=1).max() < APART_M for t in taken
        ):
            continue
        taken.append(ends)
        near = _near(solids, way.start, way.goal, size_m, level[0].height_m)
        if reason := why_blocked(near, way):
            rejected["not traversable" if "stopped" in reason else "start or goal is not free"] += 1
            continue
        name = f"front3d_{_word(house.name)[:8]}_{len(scenes) + seed * 1000:03d}"
        source = _source(house, level[0].height_m)
        scenes.append(crop(name, near, way.start, way.goal, size_m, source))
    return Front3dScenes(scenes=tuple(scenes), report=house.report, solids=dict(solids.solids), rejected=dict(rejected))


def floor_below(house: House, p_H: ArrayLike) -> Floor | None:
    """The floor that x, y [m] lies on, the lowest of several; None off every floor."""
    p = np.asarray(p_H, dtype=float)
    here = [f for f in house.floors if _on(f, p[None])[0]]
    return min(here, key=lambda f: f.height_m) if here else None


def level_clearance(house: House, level: list[Floor]) -> ClearanceMap:
    """Distance to what stands or hangs where a robot reaches, over floors of one height."""
    corners = np.concatenate([f.triangles.reshape(-1, 2) for f in level])
    origin = corners.min(axis=0) - 2 * SPACING_M
    shape = np.ceil((corners.max(axis=0) + 2 * SPACING_M - origin) / SPACING_M).astype(int) + 1
    nodes = origin + SPACING_M * np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), axis=-1)
    on_floor = np.any([_on(f, nodes.reshape(-1, 2)) for f in level], axis=0).reshape(shape)
    grown = binary_dilation(on_floor, np.ones((3, 3)), iterations=round(DOORWAY_M / SPACING_M))
    low = np.array([*origin, level[0].height_m + TOUCHED_M[0]])
    high = np.array([*nodes[-1, -1], level[0].height_m + TOUCHED_M[1]])
    reach = {"furniture": np.ones(shape), "structure": np.ones(shape)}
    for piece in house.pieces:
        p = sample_surface(piece.corners_H, SPACING_M / 2, low, high)
        if len(p):
            distance = KDTree(p[:, :2]).query(nodes, distance_upper_bound=1.0)[0]
            reach[piece.kind] = np.minimum(reach[piece.kind], distance)
    nearest = np.where(grown, np.minimum(*reach.values()), OFF_LIMITS_M)
    return ClearanceMap(origin=origin, nearest=nearest, things=reach["furniture"])


def _levels(house: House) -> list[list[Floor]]:
    """Floors by height, from low to high."""
    levels: list[list[Floor]] = []
    for floor in sorted(house.floors, key=lambda f: f.height_m):
        if levels and floor.height_m - levels[-1][0].height_m < LEVEL_M:
            levels[-1].append(floor)
        else:
            levels.append([floor])
    return levels


def _near(solids: SolidHouse, start: ArrayLike, goal: ArrayLike, size_m: Size, floor_m: float) -> list[Obstacle]:
    middle, reach = (
        0.5 * (np.array(start, dtype=float) + np.array(goal, dtype=float)),
        0.5 * float(np.hypot(*size_m[:2])),
    )
    low, high = np.array([*(middle - reach), 0.0]), np.array([*(middle + reach), size_m[2]])
    return solids.obstacles(low, high, floor_m)


def _source(house: House, floor_m: float) -> MapSource | None:
    """Where the house's file lies in a frame that has one of its floors at z = 0."""
    return house.source and house.source.moved((0.0, 0.0, -floor_m), (1.0, 0.0, 0.0, 0.0))


def _on(floor: Floor, p: Array) -> NDArray[np.bool_]:
    """Whether points (n, 2) lie on the floor, its border included."""
    result = np.zeros(len(p), dtype=bool)
    for a, b, c in floor.triangles:
        sides = [
            (q[0] - o[0]) * (p[:, 1] - o[1]) - (q[1] - o[1]) * (p[:, 0] - o[0]) for o, q in ((a, b), (b, c), (c, a))
        ]
        result |= (np.min(sides, axis=0) >= -1e-9) | (np.max(sides, axis=0) <= 1e-9)
    return result


def _boxes(piece: PlacedMesh, solid: Solid) -> list[Obstacle]:
    centres = piece.position_m + quat_rotate(np.array(piece.quaternion_wxyz), solid.boxes.mean(axis=1))
    sizes = solid.boxes[:, 1] - solid.boxes[:, 0]
    return [
        Obstacle(f"{piece.name}_box_{k}", "side", BoxShape(tuple(size)), tuple(centre), piece.quaternion_wxyz)
        for k, (size, centre) in enumerate(zip(sizes.tolist(), centres.tolist(), strict=True), 1)
    ]


def _word(name: str) -> str:
    return re.sub(r"\W+", "_", name)


def import_front3d(config: Front3dConfig) -> int:
    """Writes scenes of a house and prints what became of its parts. Raises as `front3d_scenes` does.

    Returns 1 when the house holds no way that passes furniture and can be crossed, else 0.
    """
    from rich.table import Table

    from hotice.console import PlainConsole

    console = PlainConsole()
    with doing(f"importing {config.house}"), tempfile.TemporaryDirectory(prefix="hotice-import-") as folder:
        found = front3d_scenes(
            config.house,
            config.models,
            folder,
            count=config.count,
            seed=config.seed,
            size_m=config.size_m,
        )
        save_all(found.scenes, config.out)
    table = Table("", "", "number", title=f"{config.house.name}: {len(found.scenes)} scenes in {config.out}")
    rows = [*found.report.rows(), *(("solid", k, n) for k, n in sorted(found.solids.items()))]
    for part, reason, number in [*rows, *(("way rejected", k, n) for k, n in sorted(found.rejected.items()))]:
        table.add_row(part, reason, str(number))
    console.print(table)
    if share := found.report.missing_share:
        folders = ", ".join(map(str, config.models))
        console.print(
            f"{100 * share:.0f} % of the furniture is missing: its models are not in {folders}; where the data set "
            "came in parts, give all of them (--models A B ...)",
            soft_wrap=True,
        )
    return 0 if found.scenes else 1
