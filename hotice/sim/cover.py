"""A dense cover of robot and object by spheres: what training tests against the scene's signed distance.

Two errors hide a penetration. Spheres leave dents between them, at most `DENT_M` deep. And a grid shows convex
obstacles thinner than they are, most of all beside thin bars, because interpolation of a convex distance errs upwards.
So spheres along edges reach the very edge, for which they stick out of both faces by 0.4 of their depth, and thin links
get a `skin` as thick as that error; elsewhere the cover lies inside the geometry. `python -m benchmarks.collision`
measures what is missed and what is invented. Evaluation scores exact geometry instead (`hotice.evaluate.run`).
"""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np
import torch
from torch import Tensor

from hotice.fields.clearance import Spheres
from hotice.model import g1
from hotice.model.frames import quat_to_mat

DENT_M = 0.008
"""Depth to which a sharp edge can enter between two neighbouring spheres [m]."""
EDGE_DEPTH_M = 0.0175
"""Depth below both faces of the spheres along an edge of robot and object; thin boxes have none."""
EDGE_RADIUS_M = float(np.sqrt(2.0)) * EDGE_DEPTH_M
THIN_M = 0.03
"""Spheres, capsules and boxes of the robot up to this radius or half thickness get a skin."""
LEGS = ("hip_pitch_link", "hip_roll_link", "hip_yaw_link", "knee_link", "ankle_pitch_link", "ankle_roll_link")
GRID_M, BAR_M = 0.04, 0.02
"""Grid of the distances, and radius of the thin bars that the skin is for."""


def robot_cover(model: mujoco.MjModel) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Spheres that cover the robot's links; soles are left to the feet's boxes.

    Returns:
        body (S,) ids, centre (S, 3) in the body frame [m], radius (S,) [m].
    """
    bodies, centres, radii = [], [], []
    root = model.body(g1.ROOT_BODY).id
    for geom in range(model.ngeom):
        body = int(model.geom_bodyid[geom])
        if model.body_rootid[body] != root or "_sole_" in model.geom(geom).name:
            continue
        R = quat_to_mat(model.geom_quat[geom])
        for local, radius in cover_geom(int(model.geom_type[geom]), model.geom_size[geom]):
            bodies.append(np.full(len(local), body))
            centres.append(model.geom_pos[geom] + local @ R.T)
            radii.append(np.full(len(local), radius))
    return np.concatenate(bodies), np.concatenate(centres), np.concatenate(radii)


def cover_geom(kind: int, size: np.ndarray) -> list[tuple[np.ndarray, float]]:
    """Groups of sphere centres (S, 3) in the geom frame and their radius, for a sphere, capsule or box."""
    box = kind == mujoco.mjtGeom.mjGEOM_BOX
    inner = float(size.min() if box else size[0])
    radius = inner + skin(inner)
    if kind == mujoco.mjtGeom.mjGEOM_SPHERE:
        return [(np.zeros((1, 3)), radius)]
    if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        return [(_points(np.array([0.0, 0.0, size[1]]), inner), radius)]
    if not box:
        raise ValueError(f"no sphere cover for geom type {kind}")
    groups = [(_points(size - inner, inner), radius)]
    if inner > THIN_M:
        groups.append((_points(size - EDGE_DEPTH_M, EDGE_DEPTH_M, ends=2), EDGE_RADIUS_M))
    return groups


def skin(radius: float) -> float:
    """By how much the spheres of a thin link are larger than the link [m], none for a thick one.

    h² / (8 ρ) is what interpolation between nodes h apart adds to the distance of a bar whose axis lies ρ away.
    """
    return GRID_M**2 / 8.0 / (radius + BAR_M) if radius <= THIN_M else 0.0


def _points(reach: np.ndarray, radius: float, ends: int = 1) -> np.ndarray:
    """Centres (S, 3) up to `reach` (3,) from the middle, dense enough that spheres leave dents of `DENT_M` at most."""
    spacing = np.sqrt(8.0 * radius * DENT_M)
    counts = [int(np.ceil(2.0 * r / spacing)) + 1 if r > 0.002 else 1 for r in reach]
    return _lattice(counts, ends) * reach


def _lattice(counts: Sequence[int], ends: int) -> np.ndarray:
    """Grid points of the cube [-1, 1]^3: `counts` along each axis, with `ends` coordinates or more at ± 1.

    So 2 leaves the edges, 1 the faces; a single point along an axis lies in the middle and counts as an end.
    """
    index = np.stack(np.meshgrid(*map(np.arange, counts), indexing="ij"), axis=-1).reshape(-1, 3)
    last = np.array(counts) - 1
    at_end = ((index == 0) | (index == last)).sum(axis=1)
    return np.where(last > 0, 2.0 * index / np.maximum(last, 1) - 1.0, 0.0)[at_end >= ends]


_SHELLS = ((12, 2), (5, 2), (3, 1), (1, 0))
"""Points along an edge of the object and `ends` of `_lattice`, from the outer to the inner shell."""
OBJECT_SPHERES = sum(len(_lattice(3 * [count], ends)) for count, ends in _SHELLS)


def object_cover(shape: str, half_extents: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Spheres that fill the carried object: shells of them, small along edges or rims, larger within.

    Radii grow such that the spheres of two shells leave equal dents in a face. Where a shape needs fewer spheres, the
    last is repeated.

    Returns:
        centre (S, 3) in O [m], radius (S,) [m], S = `OBJECT_SPHERES`.
    """
    half = np.asarray(half_extents, dtype=float)
    inner = float(half.min())
    shells = [(np.zeros((1, 3)), inner)]
    if shape != "sphere":
        edge = min(EDGE_DEPTH_M, inner)
        depths = np.linspace(np.sqrt(edge), np.sqrt(inner), len(_SHELLS)) ** 2
        shells = []
        for depth, (count, ends) in zip(depths, _SHELLS, strict=True):
            points = _lattice(3 * [count], ends)
            if shape == "cylinder":
                points = _round(points[np.abs(points[:, 2]) == 1.0] if ends == 2 else points)
            shells.append((points * (half - depth), depth))
        shells[0] = (shells[0][0], np.sqrt(2.0) * edge)
    centre = np.concatenate([points for points, _ in shells])
    radius = np.concatenate([np.full(len(points), r) for points, r in shells])
    spare = ((0, OBJECT_SPHERES - len(radius)), (0, 0))
    return np.pad(centre, spare, mode="edge"), np.pad(radius, spare[0], mode="edge")


def _round(points: np.ndarray) -> np.ndarray:
    """Turns the squares of each layer into rings."""
    xy = points[:, :2]
    size = np.linalg.norm(xy, axis=1, keepdims=True)
    return np.column_stack([xy * np.abs(xy).max(axis=1, keepdims=True) / np.maximum(size, 1e-9), points[:, 2]])


def robot_spheres(model: mujoco.MjModel, device: torch.device) -> Spheres:
    """The robot's cover on the frames of its bodies."""
    body, centre, radius = robot_cover(model)
    return Spheres(
        frame=torch.tensor(body, dtype=torch.int64, device=device),
        centre=torch.tensor(centre, dtype=torch.float32, device=device)[None],
        radius=torch.tensor(radius, dtype=torch.float32, device=device)[None],
    )


def upper_spheres(model: mujoco.MjModel, device: torch.device) -> Spheres:
    """Those of trunk, head and arms."""
    whole = robot_spheres(model, device)
    upper = [not model.body(int(b)).name.endswith(LEGS) for b in whole.frame]
    keep = torch.tensor(upper, device=device)
    return Spheres(
        frame=whole.frame[keep], centre=whole.centre[:, keep].contiguous(), radius=whole.radius[:, keep].contiguous()
    )


def object_spheres(centre: Tensor, radius: Tensor, body: int) -> Spheres:
    """Covers of M objects, centre (M, S, 3) and radius (M, S) [m], on the object's body."""
    frame = torch.full((centre.shape[1],), body, dtype=torch.int64, device=centre.device)
    return Spheres(frame=frame, centre=centre.contiguous(), radius=radius.contiguous())
