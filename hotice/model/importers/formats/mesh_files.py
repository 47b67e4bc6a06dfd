"""Mesh files of every known format as vertices and triangles."""

from __future__ import annotations

import io

import numpy as np
from numpy.typing import NDArray

from hotice.errors import InvalidMap
from hotice.model.importers.formats.gltf import read_glb
from hotice.model.importers.formats.obj import read_obj
from hotice.model.importers.formats.off import read_off
from hotice.model.importers.formats.ply_faces import read_ply_mesh

Mesh = tuple[NDArray[np.float64], NDArray[np.int64]]


def read_mesh(content: bytes, suffix: str) -> Mesh:
    """Vertices (V, 3) [the file's unit], which may be not finite, and triangles (F, 3), which may have no area.

    Polygons are filled by their shape, see `polygons`. Raises `InvalidMap` for a file that cannot be read whole.
    """
    return {".glb": read_glb, ".obj": read_obj, ".off": read_off, ".ply": read_ply_mesh, ".stl": _read_stl}[suffix](
        content
    )


def _read_stl(content: bytes) -> Mesh:
    import trimesh

    try:
        mesh = trimesh.load_mesh(io.BytesIO(content), file_type="stl", process=False)
    except Exception as error:  # any failure of a parser on an untrusted file is the file's
        raise InvalidMap(f"is no STL: {' '.join(str(error).split())[:200] or type(error).__name__}") from None
    return np.asarray(mesh.vertices, dtype=np.float64), np.asarray(mesh.faces, dtype=np.int64).reshape(-1, 3)
