"""Looks of the robot: Unitree's meshes where example-robot-data is installed, for drawing only."""

from __future__ import annotations

import sys
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from hotice.model.frames import quat_from_axis_angle, quat_to_mat

Array = NDArray[np.float64]
GRID_M = 0.008
"""Vertices closer than this become one: the page stays light, the looks stay."""
URDF = "robots/g1_description/urdf/g1_29dof_rev_1_0.urdf"


@lru_cache(maxsize=1)
def robot_meshes() -> dict[str, tuple[Array, NDArray[np.int32]]]:
    """Vertices (V, 3) in the link [m] and faces (F, 3) of each link by name; empty where the package is missing."""
    folder = _folder()
    if folder is None or find_spec("trimesh") is None:
        return {}
    root = ElementTree.parse(folder / URDF).getroot()
    fixed = {_name(j, "child", "link"): j for j in root.iter("joint") if j.get("type") == "fixed"}
    parts: dict[str, list[tuple[Array, NDArray[np.int32]]]] = {}
    for link in root.iter("link"):
        for visual in link.iter("visual"):
            mesh = visual.find("geometry/mesh")
            if mesh is None:
                continue
            vertices, faces = _coarse(folder / "robots" / mesh.attrib["filename"].split("robots/")[-1])
            vertices, name = _moved(vertices, visual.find("origin")), str(link.get("name"))
            while name in fixed:  # links behind fixed joints move with their parent
                vertices, name = _moved(vertices, fixed[name].find("origin")), _name(fixed[name], "parent", "link")
            parts.setdefault(name, []).append((vertices, faces))
    return {name: _joined(several) for name, several in parts.items()}


def _name(element: ElementTree.Element, tag: str, attribute: str) -> str:
    child = element.find(tag)
    return "" if child is None else str(child.get(attribute))


def _folder() -> Path | None:
    for base in sys.path:
        for place in ("cmeel.prefix/share", "../../../share"):
            folder = Path(base) / place / "example-robot-data"
            if (folder / URDF).is_file():
                return folder
    return None


def _coarse(path: Path) -> tuple[Array, NDArray[np.int32]]:
    """A mesh with its vertices on a grid of `GRID_M`, without the faces that vanish."""
    import trimesh

    mesh = trimesh.load(path, process=False, force="mesh")
    cells, which = np.unique(np.round(np.asarray(mesh.vertices) / GRID_M), axis=0, return_inverse=True)
    faces = which.reshape(-1)[np.asarray(mesh.faces)]
    solid = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
    faces = faces[solid]
    _, first = np.unique(np.sort(faces, axis=1), axis=0, return_index=True)
    return cells * GRID_M, faces[first].astype(np.int32)


def _moved(vertices: Array, origin: ElementTree.Element | None) -> Array:
    """Vertices in the frame that `origin` places them in."""
    if origin is None:
        return vertices
    R = np.eye(3)
    for axis, angle in zip(np.eye(3), map(float, origin.get("rpy", "0 0 0").split()), strict=True):  # about fixed axes
        R = quat_to_mat(quat_from_axis_angle(axis, np.asarray(angle))) @ R
    return vertices @ R.T + np.array([float(v) for v in origin.get("xyz", "0 0 0").split()])


def _joined(several: list[tuple[Array, NDArray[np.int32]]]) -> tuple[Array, NDArray[np.int32]]:
    starts = np.cumsum([0, *(len(v) for v, _ in several)])
    faces = [f + np.int32(start) for (_, f), start in zip(several, starts, strict=False)]
    return np.concatenate([v for v, _ in several]), np.concatenate(faces)
