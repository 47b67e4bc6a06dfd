"""Solved scenes on disk, one file each, named by a hash of all that decides their content.

A file holds a line of JSON (format, grid, steps, length, and a CRC of all that it holds) and the raw node values; it
is written aside and then renamed, so a killed build leaves whole files only, and it is never executed. A bank is one
more file of that kind with the values of all its scenes one after another, which is mapped into memory. A file whose
CRC is another one is made anew, with a warning.
"""

from __future__ import annotations

import hashlib
import json
import warnings
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hotice.caches import cache_folder
from hotice.documents import parse_json
from hotice.errors import InputError, OutputError
from hotice.fields.grid import Grid
from hotice.fields.volumes import NODE_BYTES, SceneNodes, Volumes, arrange
from hotice.files import make_folder, write_bytes, written_aside
from hotice.model.geometry.shapes import MeshShape
from hotice.model.scene import Scene

SOLVER = "hotice-field/5"
"""Changes whenever equal scenes may give other values."""
_HEADER_BYTES = 4096
_MOST_HEADER_BYTES = 64 * 2**20


class BrokenCacheFile(UserWarning):
    """A cached file that was damaged and is made anew."""


def default_folder() -> Path:
    """Folder of solved scenes, see `hotice.caches`. Raises `OutputError`."""
    return cache_folder("fields")


def scene_key(scene: Scene, resolution_m: float, margins_m: tuple[float, ...]) -> str:
    """Hash of geometry (bytes of mesh files included), grid, margins and solver; names and categories do not count."""
    data = scene.to_dict()
    shapes = [(o.shape.to_dict(), o.position_m, o.quaternion_wxyz) for o in scene.obstacles]
    facts = [SOLVER, data["bounds_m"], data["goal"], resolution_m, margins_m, shapes]
    digest = hashlib.sha256(json.dumps(facts).encode())
    for obstacle in scene.obstacles:
        if isinstance(obstacle.shape, MeshShape):
            digest.update(hashlib.sha256(obstacle.shape.path.read_bytes()).digest())
    return digest.hexdigest()[:32]


def save(folder: Path, key: str, nodes: SceneNodes) -> None:
    """Writes a solved scene with two margins. Raises `OutputError`."""
    make_folder(folder)
    content = b"".join(a.tobytes() for a in (nodes.sdf, *nodes.geo))
    write_bytes(folder / f"{key}.field", _header([nodes.grid], [nodes.step], [content]) + content)


def load(folder: Path, key: str) -> tuple[Grid, tuple[float, ...], NDArray[np.uint8]] | None:
    """Grid, steps and raw node values of a solved scene; None when there is none or, with a warning, a damaged one."""
    path = folder / f"{key}.field"
    if not path.is_file():
        return None
    found = _open(path)
    if found is None:
        warnings.warn(f"{path} is damaged: its scene is solved again", BrokenCacheFile, stacklevel=2)
        return None
    header, raw = found
    return _grids(header)[0], tuple(header["steps"][0]), raw


def open_bank(folder: Path, keys: list[str]) -> Volumes | None:
    """Volumes of the scenes of these keys, mapped from one file; None without one or, with a warning, a damaged one."""
    path = _bank_path(folder, keys)
    if not path.is_file():
        return None
    found = _open(path)
    if found is None:
        warnings.warn(f"{path} is damaged: it is made again", BrokenCacheFile, stacklevel=2)
        return None
    header, raw = found
    total = len(raw) // NODE_BYTES
    geo = (raw[4 * total : 12 * total], raw[12 * total :])
    packed = tuple(g.view(np.int16).reshape(-1, 4) for g in geo)
    steps = [tuple(s) for s in header["steps"]]
    return arrange(_grids(header), steps, raw[: 4 * total].view(np.float32), packed)


def make_bank(folder: Path, keys: list[str]) -> Volumes:
    """Joins the scenes of these keys, all of which are cached, in one file. Raises `OutputError`."""
    _write_bank(_bank_path(folder, keys), folder, keys)
    volumes = open_bank(folder, keys)
    if volumes is None:
        raise OutputError(f"the bank just written to {folder} cannot be read back: is the disk full?")
    return volumes


def _bank_path(folder: Path, keys: list[str]) -> Path:
    return folder / f"{hashlib.sha256(''.join(keys).encode()).hexdigest()[:32]}.bank"


def _write_bank(path: Path, folder: Path, keys: list[str]) -> None:
    scenes = []
    for key in keys:
        scene = load(folder, key)
        if scene is None:
            raise OutputError(f"{folder / key}.field vanished while the bank was built: build it again")
        scenes.append(scene)
    grids, steps = [s[0] for s in scenes], [s[1] for s in scenes]
    parts = [
        raw[low * grid.size : high * grid.size].data
        for low, high in ((0, 4), (4, 12), (12, 20))
        for grid, _, raw in scenes
    ]
    with written_aside(path) as aside, aside.open("wb") as file:
        file.write(_header(grids, steps, parts))
        for part in parts:
            file.write(part)


def _header(grids: list[Grid], steps: list[tuple[float, ...]], parts: Sequence[bytes | memoryview]) -> bytes:
    """JSON padded with spaces to a whole number of pages."""
    facts = {
        "format": SOLVER,
        "resolution_m": grids[0].resolution_m,
        "origins": [g.origin.tolist() for g in grids],
        "shapes": [g.shape for g in grids],
        "steps": steps,
        "length": sum(len(part) for part in parts),
    }
    text = json.dumps({**facts, "crc": _crc(facts, parts)}).encode() + b"\n"
    return text[:-1].ljust(-(-len(text) // _HEADER_BYTES) * _HEADER_BYTES - 1) + b"\n"


def _crc(facts: dict[str, Any], parts: Sequence[bytes | memoryview]) -> int:
    """CRC-32 of what a header says and of the node values."""
    crc = zlib.crc32(json.dumps(facts, sort_keys=True).encode())
    for part in parts:
        crc = zlib.crc32(part, crc)
    return crc


def _grids(header: dict[str, Any]) -> list[Grid]:
    h = header["resolution_m"]
    return [Grid(np.array(o), tuple(s), h) for o, s in zip(header["origins"], header["shapes"], strict=True)]


def _open(path: Path) -> tuple[dict[str, Any], NDArray[np.uint8]] | None:
    """Header and mapped content (private: writes to it stay in memory), or None when it is not whole."""
    try:
        with path.open("rb") as file:
            line = file.readline(_MOST_HEADER_BYTES)
        header = parse_json(str(path), line)
        sizes = [int(np.prod(s)) for s in header["shapes"]]
        whole = header["format"] == SOLVER and header["length"] == NODE_BYTES * sum(sizes)
        if not whole or path.stat().st_size != len(line) + header["length"]:
            return None
        raw = np.memmap(path, dtype=np.uint8, mode="c", offset=len(line))
        facts = {name: value for name, value in header.items() if name != "crc"}
        return (header, raw) if _crc(facts, [raw.data]) == header["crc"] else None
    except (OSError, ValueError, OverflowError, KeyError, TypeError, InputError):
        return None
