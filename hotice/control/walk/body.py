"""The upper body and its load as spheres: what has to pass between and below obstacles, apart from the feet."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import mujoco
import numpy as np
from numpy.typing import NDArray

from hotice.model import builder, g1
from hotice.model.carry import CarryState
from hotice.model.frames import quat_to_mat

Array = NDArray[np.float64]
SPACING_M = 0.06
_LEGS = ("knee_link", "ankle_pitch_link", "ankle_roll_link")


@dataclass(frozen=True, eq=False)
class BodySpheres:
    """Spheres that cover trunk, thighs, arms and head, and points of the object's surface.

    Positions are relative to the middle between the ankles, soles on z = 0, heading +x: robot (N, 3), its radii (N,),
    object (M, 3) [m]. sole_ahead_m: from the ankles to the middle of the soles [m].
    """

    robot: Array
    radius: Array
    load: Array
    sole_ahead_m: float

    @property
    def half_width_m(self) -> float:
        """Largest extent to a side [m]."""
        return float(
            max(np.abs(self.robot[:, 1] + np.sign(self.robot[:, 1]) * self.radius).max(), np.abs(self.load[:, 1]).max())
        )

    @property
    def height_m(self) -> float:
        """Height of the top of the head over the soles [m]."""
        return float((self.robot[:, 2] + self.radius).max())


@lru_cache(maxsize=4)
def _robot(wrist_pos: tuple[float, ...]) -> mujoco.MjModel:
    return builder.build_model(None, wrist_pos=np.array(wrist_pos), floor=False)


def body_spheres(state: CarryState) -> BodySpheres:
    """Spheres of the robot in a carry state, shifted so that the feet are under the origin."""
    model = _robot(tuple(np.round(state.wrist_pos, 9)))
    data = mujoco.MjData(model)
    data.qpos[g1.ROOT_POS], data.qpos[g1.ROOT_QUAT], data.qpos[g1.JOINT_POS] = (
        state.root_pos_W,
        state.quat_WP,
        state.joint_pos,
    )
    mujoco.mj_kinematics(model, data)
    centres, radii = [], []
    for geom in range(model.ngeom):
        body = model.body(model.geom_bodyid[geom]).name
        if body.endswith(_LEGS):
            continue
        points, radius = _cover(model.geom_type[geom], model.geom_size[geom])
        R = data.geom_xmat[geom].reshape(3, 3)
        centres.append(points @ R.T + data.geom_xpos[geom])
        radii.append(np.full(len(points), radius))
    ankles = [data.body(f"{side}_ankle_roll_link").xpos[:2] for side in g1.SIDES]
    origin = np.append(np.mean(ankles, axis=0), 0.0)
    load = _surface(state.carried.half_extents_m) @ quat_to_mat(state.quat_WO).T + state.object_pos_W
    return BodySpheres(np.concatenate(centres) - origin, np.concatenate(radii), load - origin, float(-origin[0]))


def _cover(kind: int, size: Array) -> tuple[Array, float]:
    """Spheres along a capsule, or on the middle sheet of a box as thick as its least extent."""
    if kind == mujoco.mjtGeom.mjGEOM_SPHERE:
        return np.zeros((1, 3)), float(size[0])
    if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        z = _line(float(size[1]))
        return np.column_stack([np.zeros((len(z), 2)), z]), float(size[0])
    least = float(size.min())
    axes = [_line(max(float(s) - 0.6 * least, 0.0)) for s in size]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3), 0.75 * least


def _line(half: float) -> Array:
    return np.linspace(-half, half, 1 + 2 * int(np.ceil(half / SPACING_M))) if half > 0 else np.zeros(1)


def _surface(half: Array) -> Array:
    """Points on the surface of the bounding box: corners, edges and faces, (M, 3) [m]."""
    axes = [np.linspace(-h, h, 1 + 2 * int(np.ceil(h / (2 * SPACING_M)))) for h in half]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    return points[(np.abs(np.abs(points) - half) < 1e-9).any(axis=1)]
