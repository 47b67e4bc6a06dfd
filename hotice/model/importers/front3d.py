"""Houses of the 3D-FRONT data set: a JSON file each, with models in folders `<jid>/raw_model.obj` (3D-FUTURE).

`furniture[]` names models (uid, jid, valid, size), `mesh[]` holds walls, floors and built-in parts (uid, type, xyz,
faces, normal), `scene.room[].children[]` places either by `ref` with `pos`, `rot` (x, y, z, w) and `scale`. The file's
frame is y up; a vertex is scaled, rotated, then moved. Ours is z up: (x, y, z) becomes (x, -z, y), a rotation, so that
nothing is mirrored.

The data are as people made them: what cannot be used is left out and counted, by reason, in `Front3dReport`.
"""

from __future__ import annotations

import hashlib
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hotice.documents import parse_json
from hotice.errors import InputError, InvalidMap
from hotice.files import is_folder, read_bytes
from hotice.model.frames import quat_rotate, quat_to_mat
from hotice.model.importers.meshes import read_triangles
from hotice.model.importers.polygons import triangulated, unit_normals
from hotice.model.source import MapSource

MAX_JSON_BYTES = 256 * 2**20
MAX_MODEL_BYTES = 128 * 2**20
MAX_ENTRIES = 100_000
"""Furniture, meshes or placed things in one house."""
SCALE_RANGE = (0.01, 5.0)
SIZE_RANGE_M = (0.01, 8.0)
"""Range of the longest side of a placed piece of furniture."""
FARTHEST_M = 1000.0
MISSING = "missing model"
JID = re.compile(r"[A-Za-z0-9_-][A-Za-z0-9._-]{0,99}")
NOT_FINITE = re.compile(rb"^v\b.*\b(nan|inf)", re.IGNORECASE | re.MULTILINE)

Points = NDArray[np.float64]
Quat = tuple[float, float, float, float]


@dataclass(frozen=True, kw_only=True)
class Front3dReport:
    """Account of a house: `used` by kind, `dropped` by reason, `mended` (used all the same) by what was wrong."""

    used: Mapping[str, int]
    dropped: Mapping[str, int]
    mended: Mapping[str, int]

    @property
    def missing_share(self) -> float:
        """Share of the placed pieces of furniture whose model is in none of the folders, 0 to 1."""
        missing = self.dropped.get(MISSING, 0)
        return missing / max(missing + self.used.get("furniture", 0), 1)

    def rows(self) -> list[tuple[str, str, int]]:
        """(used, dropped or mended; kind or reason; number), for printing."""
        parts = (("used", self.used), ("dropped", self.dropped), ("mended", self.mended))
        return [(part, reason, number) for part, table in parts for reason, number in sorted(table.items())]


@dataclass(frozen=True, eq=False, kw_only=True)
class PlacedMesh:
    """Triangles `corners` (F, 3, 3) in their own frame B (z up, scaled) at pose X_HB [m]; H is the house's frame."""

    name: str
    kind: str
    corners: Points
    position_m: tuple[float, float, float]
    quaternion_wxyz: Quat

    @property
    def corners_H(self) -> Points:
        """Triangles in H, (F, 3, 3) [m]."""
        return self.corners @ quat_to_mat(self.quaternion_wxyz).T + np.array(self.position_m)


@dataclass(frozen=True, eq=False, kw_only=True)
class Floor:
    """The floor of a room: its type, `triangles` (F, 3, 2) in H and height [m]."""

    room: str
    triangles: Points
    height_m: float


@dataclass(frozen=True, eq=False, kw_only=True)
class House:
    """Furniture, walls and floors in H: z up, the largest floor at z = 0."""

    name: str
    pieces: tuple[PlacedMesh, ...]
    floors: tuple[Floor, ...]
    report: Front3dReport
    ground_m: float = 0.0
    """Height of the largest floor in the file."""
    source: MapSource | None = None


def load_house(json_path: str | Path, models_folders: str | Path | Sequence[str | Path]) -> House:
    """Reads a house and the models that it places, each from the first of the folders that has it.

    Raises:
        InputError: a file is missing, too large or unreadable, or a folder of models is missing.
        InvalidMap: the file is not a house: no JSON, nested too deeply, without rooms, or without any floor.
    """
    single = isinstance(models_folders, str | Path)
    json_path, models = Path(json_path), tuple(map(Path, [models_folders] if single else models_folders))
    for folder in models:
        if not is_folder(folder):
            raise InputError(f"{folder}: no such folder of models (it holds <jid>/raw_model.obj)")
    content = read_bytes(json_path, MAX_JSON_BYTES)
    data = parse_json(str(json_path), content, InvalidMap)
    try:
        house = _Loader(data, models).house(json_path.stem)
        digest = hashlib.sha256(content).hexdigest()
        source = MapSource.of(
            file=json_path.name,
            sha256=digest,
            unit_m=1.0,
            R_WM=_z_up(np.eye(3)).T,
            position_m=(0.0, 0.0, -house.ground_m),
        )
        return replace(house, source=source)
    except InvalidMap as error:
        raise InvalidMap(f"{json_path}: {error}") from None


class _Defect(Exception):
    """Why one entry cannot be used."""


class _Loader:
    """Places the entries of a parsed house and counts what it leaves out."""

    def __init__(self, data: Any, models: tuple[Path, ...]) -> None:
        self.models = models
        self.used, self.dropped, self.mended = Counter[str](), Counter[str](), Counter[str]()
        self.furniture = self._by_uid(_list(data, "furniture"))
        self.meshes = self._by_uid(_list(data, "mesh"))
        self.rooms = _list(_mapping(data).get("scene"), "room")
        if not self.rooms:
            raise InvalidMap("holds no scene.room: a 3D-FRONT house is needed")
        self.loaded: dict[str, Points | _Defect] = {}
        self.pieces: list[PlacedMesh] = []
        self.floors: list[Floor] = []

    def house(self, name: str) -> House:
        """The house with its largest floor at z = 0."""
        placed: set[str] = set()
        for number, room in enumerate(self.rooms, 1):
            title = f"{_mapping(room).get('type') or 'room'}_{number}"
            for child in _list(room, "children"):
                self._try(self._place, child, re.sub(r"\W", "_", title), placed)
        for uid in self.meshes.keys() - placed:
            self.mended["mesh in no room, placed as it is"] += 1
            self._try(self._place, {"ref": uid}, "house", placed)
        if not self.floors:
            raise InvalidMap("holds no floor: a mesh of a type such as Floor is needed")
        ground = max(self.floors, key=_area).height_m
        pieces = [_lowered(p, ground) for p in self.pieces]
        floors = [replace(f, height_m=f.height_m - ground) for f in self.floors]
        report = Front3dReport(used=dict(self.used), dropped=dict(self.dropped), mended=dict(self.mended))
        return House(name=name, pieces=tuple(pieces), floors=tuple(floors), report=report, ground_m=ground)

    def _try(self, place, *arguments: Any) -> None:
        try:
            place(*arguments)
        except _Defect as defect:
            self.dropped[str(defect)] += 1

    def _by_uid(self, entries: list[Any]) -> dict[str, Mapping[str, Any]]:
        table: dict[str, Mapping[str, Any]] = {}
        for entry in entries:
            uid = _mapping(entry).get("uid")
            if not isinstance(uid, str):
                self.dropped["entry without uid"] += 1
            elif uid in table:
                self.dropped["uid given twice"] += 1
            else:
                table[uid] = entry
        return table

    def _place(self, child: Any, room: str, placed: set[str]) -> None:
        ref = _mapping(child).get("ref")
        if not isinstance(ref, str) or ref not in self.furniture and ref not in self.meshes:
            raise _Defect("dangling reference")
        if ref in self.meshes:
            placed.add(ref)
        position, quat, scale = _pose(_mapping(child))
        if ref in self.furniture:
            self._place_furniture(self.furniture[ref], room, position, quat, scale)
        else:
            self._place_mesh(self.meshes[ref], room, position, quat, scale)

    def _place_furniture(
        self, entry: Mapping[str, Any], room: str, position: Points, quat: Points, scale: Points
    ) -> None:
        if entry.get("valid", True) is not True:
            raise _Defect("furniture marked as not valid")
        corners = self._model(entry) * scale
        longest = float(np.ptp(corners.reshape(-1, 3), axis=0).max())
        if not SIZE_RANGE_M[0] <= longest <= SIZE_RANGE_M[1]:
            raise _Defect("furniture of absurd size")
        if "valid" not in entry:
            self.mended["furniture without valid flag"] += 1
        self._add("furniture", str(entry.get("title") or "furniture"), room, corners, position, quat)

    def _place_mesh(self, entry: Mapping[str, Any], room: str, position: Points, quat: Points, scale: Points) -> None:
        kind = str(entry.get("type") or "structure").strip().lower()
        if "ceil" in kind or kind == "hole":
            raise _Defect("ceiling or hole, on purpose")
        corners = self._triangles(entry) * scale
        if "floor" not in kind:
            self._add("structure", kind, room, corners, position, quat)
            return
        corners_H = _z_up(quat_rotate(quat, corners) + position)
        self.used["floor"] += 1
        self.floors.append(Floor(room=room, triangles=corners_H[..., :2], height_m=float(corners_H[..., 2].max())))

    def _add(self, kind: str, title: str, room: str, corners: Points, position: Points, quat: Points) -> None:
        w, x, y, z = quat.tolist()
        name = re.sub(r"\W+", "_", f"{room}_{title.split('/')[0]}").strip("_").lower()[:60]
        self.used[kind] += 1
        self.pieces.append(
            PlacedMesh(
                name=f"{name}_{len(self.pieces) + 1}",
                kind=kind,
                corners=_z_up(corners),
                position_m=tuple(_z_up(position).tolist()),
                quaternion_wxyz=(w, x, -z, y),
            )
        )

    def _model(self, entry: Mapping[str, Any]) -> Points:
        """Triangles of a model in its own frame, y up; read once."""
        jid = entry.get("jid")
        if not isinstance(jid, str) or not JID.fullmatch(jid):
            raise _Defect("unsafe model name")
        if jid not in self.loaded:
            try:
                self.loaded[jid] = self._read_model(jid, entry)
            except _Defect as defect:
                self.loaded[jid] = defect
        result = self.loaded[jid]
        if isinstance(result, _Defect):
            raise result
        return result

    def _read_model(self, jid: str, entry: Mapping[str, Any]) -> Points:
        places = [(f, f / jid / f"{kind}_model.obj") for kind in ("raw", "normalized") for f in self.models]
        folder, path = next(((f, p) for f, p in places if p.exists()), (None, None))
        if folder is None or path is None:
            raise _Defect(MISSING)
        if not path.resolve().is_relative_to(folder.resolve()):
            raise _Defect("model outside the models' folder")
        try:
            content = read_bytes(path, MAX_MODEL_BYTES)
            corners = read_triangles(content, ".obj")
        except (InputError, InvalidMap):
            raise _Defect("unreadable model") from None
        if NOT_FINITE.search(content):
            self.mended["model with non-finite vertices"] += 1
        if path.name.startswith("normalized"):
            self.mended["normalized model scaled to its size"] += 1
            return _sized(corners, _numbers(entry.get("size"), 3, MISSING))
        return corners

    def _triangles(self, entry: Mapping[str, Any]) -> Points:
        """Triangles (F, 3, 3) of a mesh entry, y up."""
        p = _numbers(entry.get("xyz"), None, "mesh without triangles")
        normals = entry.get("normal")
        faces = entry.get("faces")
        if len(p) % 3 or not isinstance(faces, list) or not faces:
            raise _Defect("mesh without triangles")
        p = p.reshape(-1, 3)
        if isinstance(normals, list) and len(normals) == p.size:
            normals = _numbers(normals, None, "mesh without triangles").reshape(-1, 3)
        else:
            normals = None
        try:
            triangles, polygons = triangulated(faces, p, normals)
        except ValueError:
            raise _Defect("mesh with impossible faces") from None
        corners = p[triangles]
        good = np.isfinite(unit_normals(corners)).all(axis=1) & (np.abs(corners).max(axis=(1, 2)) < FARTHEST_M)
        if not good.any():
            raise _Defect("mesh without triangles")
        if polygons:
            self.mended["mesh of quads"] += 1
        if not np.isfinite(corners).all():
            self.mended["mesh with non-finite vertices"] += 1
        return corners[good]


def _mapping(value: Any) -> Mapping[str, Any]:
    return value if isinstance(value, Mapping) else {}


def _list(value: Any, key: str) -> list[Any]:
    entries = _mapping(value).get(key)
    if not isinstance(entries, list):
        return []
    if len(entries) > MAX_ENTRIES:
        raise InvalidMap(f"{key} holds {len(entries):,} entries: at most {MAX_ENTRIES:,} are allowed")
    return entries


def _numbers(value: Any, length: int | None, defect: str) -> Points:
    """Numbers as (length,) floats, which may be not finite; `_Defect` for anything else."""
    if not isinstance(value, list) or length is not None and len(value) != length:
        raise _Defect(defect)
    if not all(type(v) in (int, float) and (type(v) is float or abs(v) < 1e15) for v in value):
        raise _Defect(defect)
    return np.array(value, dtype=np.float64)


def _pose(child: Mapping[str, Any]) -> tuple[Points, Points, Points]:
    """Position (3,) [m], quaternion wxyz (4,) and scale (3,) of a placed thing, y up."""
    position, quat_xyzw, scale = (
        _numbers(child.get(key, default), len(default), "malformed placement")
        for key, default in (("pos", [0.0] * 3), ("rot", [0.0, 0.0, 0.0, 1.0]), ("scale", [1.0] * 3))
    )
    if not all(np.isfinite(v).all() for v in (position, quat_xyzw, scale)):
        raise _Defect("placement with non-finite numbers")
    if not SCALE_RANGE[0] <= scale.min() <= scale.max() <= SCALE_RANGE[1]:
        raise _Defect("absurd scale")
    norm = np.linalg.norm(quat_xyzw)
    if np.abs(position).max() > FARTHEST_M or not 1e-3 < norm < 1e3:
        raise _Defect("absurd placement")
    return position, np.roll(quat_xyzw, 1) / norm, scale


def _sized(corners: Points, size: Points) -> Points:
    """A model fitted to its size along each axis, standing on the origin, y up."""
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    if not (np.isfinite(size).all() and size.min() > 0.0 and (high - low).min() > 0.0):
        raise _Defect(MISSING)
    foot = np.array([0.5 * (low[0] + high[0]), low[1], 0.5 * (low[2] + high[2])])
    return (corners - foot) * (size / (high - low))


def _z_up(p: Points) -> Points:
    """(..., 3) with y up -> with z up."""
    return np.stack([p[..., 0], -p[..., 2], p[..., 1]], axis=-1)


def _lowered(piece: PlacedMesh, by_m: float) -> PlacedMesh:
    x, y, z = piece.position_m
    return replace(piece, position_m=(x, y, z - by_m))


def _area(floor: Floor) -> float:
    a, b = floor.triangles[:, 1] - floor.triangles[:, 0], floor.triangles[:, 2] - floor.triangles[:, 0]
    return float(0.5 * np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum())
