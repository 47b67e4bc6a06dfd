"""A dense cover of robot and object by spheres: what training tests against the scene's signed distance.

Every primitive of the robot is filled with spheres that stick out of it by at most the grid's own error, so that no deep
penetration is missed and a grazing one is not invented. Evaluation scores exact geometry instead (`hotice.learn.evaluate`).
"""

from __future__ import annotations

from itertools import product

import mujoco
import numpy as np
import torch
from torch import Tensor

from hotice.model import g1
from hotice.model.frames import quat_to_mat

SPACING_M = 0.05
THICK_M, EDGE_RADIUS_M = 0.04, 0.025
_EDGES = np.array([p for p in product((-1.0, 0.0, 1.0), repeat=3) if np.abs(p).sum() >= 2])


def robot_cover(model: mujoco.MjModel) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Spheres that cover the robot's links.

    Returns:
        body (S,) ids, centre (S, 3) in the body frame [m], radius (S,) [m].
    """
    bodies, centres, radii = [], [], []
    root = model.body(g1.ROOT_BODY).id
    for geom in range(model.ngeom):
        name = model.geom(geom).name
        body = int(model.geom_bodyid[geom])
        if model.body_rootid[body] != root or "_sole_" in name or "_palm_" in name:
            continue
        R = quat_to_mat(model.geom_quat[geom])
        for local, radius in cover_geom(int(model.geom_type[geom]), model.geom_size[geom]):
            for centre in local:
                bodies.append(body)
                centres.append(model.geom_pos[geom] + R @ centre)
                radii.append(radius)
    return np.array(bodies), np.array(centres), np.array(radii)


def cover_geom(kind: int, size: np.ndarray) -> list[tuple[np.ndarray, float]]:
    """Groups of sphere centres (S, 3) in the geom frame and their radius, for a sphere, capsule or box.

    A row of spheres as thick as the geom; a thick box also has small ones in its corners and halfway along its edges.
    """
    if kind == mujoco.mjtGeom.mjGEOM_SPHERE:
        return [(np.zeros((1, 3)), float(size[0]))]
    if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        count = max(1, int(np.ceil(2 * size[1] / SPACING_M)) + 1) if size[1] > 0.005 else 1
        z = np.linspace(-size[1], size[1], count) if count > 1 else np.zeros(1)
        return [(np.stack([np.zeros(count), np.zeros(count), z], axis=1), float(size[0]))]
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        radius = float(np.min(size[:3]))
        axes = []
        for half in size[:3]:
            reach = half - radius
            count = max(1, int(np.ceil(2 * reach / max(SPACING_M, 1.2 * radius))) + 1) if reach > 0.003 else 1
            axes.append(np.linspace(-reach, reach, count) if count > 1 else np.zeros(1))
        groups = [(np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3), radius)]
        if radius > THICK_M:
            groups.append((_EDGES * (size[:3] - EDGE_RADIUS_M), EDGE_RADIUS_M))
        return groups
    raise ValueError(f"no sphere cover for geom type {kind}")


_GRID = np.stack(np.meshgrid(*3 * [np.linspace(-1, 1, 5)], indexing="ij"), axis=-1).reshape(-1, 3)
_GRID = np.concatenate([np.zeros((1, 3)), _GRID[np.abs(_GRID).max(axis=1) == 1.0]])
OBJECT_SPHERES = len(_GRID)


def object_cover(shape: str, half_extents: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Spheres that fill the carried object: one large in the middle, small ones along faces, edges and corners.

    Returns:
        centre (99, 3) in O [m], radius (99,) [m].
    """
    half = np.asarray(half_extents, dtype=float)
    inner = float(half.min())
    if shape == "sphere":
        return np.zeros((OBJECT_SPHERES, 3)), np.full(OBJECT_SPHERES, inner)
    grid, outside = _GRID.copy(), np.abs(_GRID) == 1.0
    if shape == "cylinder":  # the square of each layer becomes a ring, which has no edges along z
        flat = np.linalg.norm(grid[:, :2], axis=1, keepdims=True)
        grid[:, :2] /= np.maximum(flat, 1.0)
        outside = np.column_stack([outside[:, :2].any(axis=1), outside[:, 2]])
    radius = inner * np.array([1.0, 0.35, 0.2, 0.12])[outside.sum(axis=1)]
    return grid * (half - radius[:, None]), radius


def lowest_clearance(sdf: Tensor, radius: Tensor) -> Tensor:
    """Smallest distance between any sphere and the obstacles, (N, S), (S,) or (N, S) -> (N,) [m]; negative: collision."""
    return (sdf - radius).amin(dim=-1)


def to_tensors(arrays, device: torch.device) -> tuple[Tensor, Tensor, Tensor]:
    """The robot cover as tensors: body (S,) int64, centre (S, 3), radius (S,)."""
    body, centre, radius = arrays
    return (
        torch.tensor(body, dtype=torch.int64, device=device),
        torch.tensor(centre, dtype=torch.float32, device=device),
        torch.tensor(radius, dtype=torch.float32, device=device),
    )
