"""Triangle meshes as obstacles: read, checked, repaired where that is possible, and their exact signed distance."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hotice.errors import InputError, InvalidMap, InvalidScene
from hotice.files import read_bytes
from hotice.model.geometry import bvh
from hotice.model.geometry.lengths import MAX_LENGTH_M
from hotice.model.importers.formats.mesh_files import read_mesh

MAX_FACES = 200_000
MAX_MESH_BYTES = 128 * 2**20


class MeshRepaired(UserWarning):
    """A mesh file that could be used only after a repair; says which."""


@dataclass(frozen=True, eq=False)
class TriangleMesh:
    """`vertices` (V, 3) [m], `faces` (F, 3) counter-clockwise seen from outside."""

    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]

    @cached_property
    def tree(self) -> bvh.Tree:
        """The triangles in a tree of boxes."""
        return bvh.Tree.of(self.vertices[self.faces])

    @cached_property
    def ball(self) -> tuple[NDArray[np.float64], float]:
        """Centre (3,) and radius of a ball that holds the mesh [m]."""
        centre = 0.5 * (self.vertices.min(axis=0) + self.vertices.max(axis=0))
        return centre, float(np.linalg.norm(self.vertices - centre, axis=1).max())

    def signed_distance(self, p: NDArray[np.float64]) -> NDArray[np.float64]:
        """(..., 3) in the mesh's frame [m] -> (...) [m], negative inside."""
        flat = np.ascontiguousarray(p, dtype=np.float64).reshape(-1, 3)
        return bvh.signed_distances(*self.tree, flat).reshape(np.shape(p)[:-1])


def load_mesh(path: Path, scale: float) -> TriangleMesh:
    """A watertight mesh from file, scaled; small faults are repaired with a `MeshRepaired` warning.

    Raises `InvalidScene` when it cannot be read or repaired, is too large or encloses nothing.
    """
    try:
        stat = path.stat()
    except OSError as error:
        raise InvalidScene(f"mesh file {path} cannot be read: {error.strerror or error}") from None
    if stat.st_size > MAX_MESH_BYTES:
        raise InvalidScene(f"mesh file {path} is larger than {MAX_MESH_BYTES // 2**20} MiB: decimate it")
    return _load(path, scale, stat.st_mtime_ns, stat.st_size)


@lru_cache(maxsize=256)
def _load(path: Path, scale: float, _mtime: int, _size: int) -> TriangleMesh:
    import trimesh

    try:
        vertices, faces = read_mesh(read_bytes(path, MAX_MESH_BYTES), path.suffix.lower())
    except (InputError, InvalidMap) as error:
        raise InvalidScene(f"mesh file {path} cannot be read: {error}") from None
    if not len(faces):
        raise InvalidScene(f"mesh file {path} cannot be read: it holds no triangles")
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    if len(mesh.faces) > MAX_FACES:
        raise InvalidScene(f"mesh file {path} has {len(mesh.faces):,} faces: decimate it to {MAX_FACES:,} at most")
    if not np.isfinite(mesh.vertices).all():
        raise InvalidScene(f"mesh file {path} has vertices that are not finite numbers: export it again")
    if np.abs(mesh.vertices).max() * scale > MAX_LENGTH_M:
        raise InvalidScene(f"mesh file {path} reaches beyond {MAX_LENGTH_M:g} m: check its unit and scale")
    done = _repair(path, mesh)
    if done:
        warnings.warn(f"mesh file {path} was repaired: {', '.join(done)}", MeshRepaired, stacklevel=2)
    return TriangleMesh(np.array(mesh.vertices, dtype=np.float64) * scale, np.array(mesh.faces, dtype=np.int64))


def _repair(path: Path, mesh: Any) -> list[str]:
    """Makes a trimesh watertight with faces that face outwards, in place; returns what was done beyond merging.

    Self-intersections stay: the winding number counts their overlaps as inside. Raises `InvalidScene`.
    """
    import trimesh

    mesh.merge_vertices(merge_tex=True, merge_norm=True)
    mesh.update_faces(mesh.nondegenerate_faces() & mesh.unique_faces())
    if len(mesh.faces) == 0 or mesh.area == 0.0:
        raise InvalidScene(f"mesh file {path} has no area: all its triangles are degenerate")
    done = []
    if not mesh.is_watertight:
        before = len(mesh.faces)
        trimesh.repair.fill_holes(mesh)
        done.append(f"{len(mesh.faces) - before} faces fill its holes")
    if not mesh.is_watertight:
        raise InvalidScene(f"mesh file {path} is not watertight: close its holes (distance needs an inside)")
    if not mesh.is_winding_consistent:
        trimesh.repair.fix_winding(mesh)
        done.append("faces were turned to agree on the outside")
    if not mesh.is_winding_consistent:
        raise InvalidScene(f"mesh file {path} has faces that cannot agree on the outside: is it a Moebius strip?")
    if mesh.volume < 0.0:
        mesh.invert()
        done.append("it was turned inside out")
    if abs(mesh.volume) <= 1e-9 * float(np.prod(mesh.extents)) or not mesh.extents.min() > 0.0:
        raise InvalidScene(f"mesh file {path} encloses no volume: give it a thickness")
    return done
