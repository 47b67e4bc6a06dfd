"""What of robot and object touched which obstacle, and how near they came, read from the states of a rollout."""

from __future__ import annotations

from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from hotice.model.builder import OBSTACLE_PREFIX
from hotice.model.moving.mocap import place_moving
from hotice.model.scene import Scene
from hotice.replay.events import MOST_TOUCHES, RolloutEvent
from hotice.replay.shown import driven
from hotice.task.rules import MOVES_M_S, STANDS_S, walked_into

FAR_M = 1.0
"""Clearance that is not looked beyond."""
MOST_OBSTACLES = 24
"""Obstacle solids up to which clearance is measured: of meshes each face is one."""


class Touched(NamedTuple):
    """First touches as events, in the order of time; clearance (T,) [m] up to `FAR_M`, below 0 inside, or (0,)."""

    events: list[RolloutEvent]
    clearance_m: NDArray[np.float64]


def find_touches(
    model: mujoco.MjModel, qpos: NDArray[np.float64], time_s: NDArray[np.floating], scene: Scene | None = None
) -> Touched:
    """Touches in the states `qpos` (T, nq) of a model with obstacles; without any, nothing.

    `scene`: where what moves is at each time, in the order of the model's mocap bodies. A touch between two states that
    neither of them shows is not found.
    """
    obstacles = [g for g in range(model.ngeom) if model.geom(g).name.startswith(OBSTACLE_PREFIX)]
    if not obstacles:
        return Touched([], np.zeros(0))
    data, of, events, seen = mujoco.MjData(model), set(obstacles), [], set()
    met = np.bitwise_or.reduce(model.geom_contype[obstacles])
    solids = np.flatnonzero((model.geom_conaffinity & met > 0) & driven(model, model.geom_bodyid)).tolist()
    solids = solids if len(obstacles) <= MOST_OBSTACLES else []
    clearance = np.full(len(qpos) if solids else 0, FAR_M)
    moving = scene.moving if scene is not None else ()
    for frame, state in enumerate(qpos):
        data.qpos[:] = state
        place_moving(data, moving, float(time_s[frame]))
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_collision(model, data)
        for geoms, gap in zip(data.contact.geom.tolist(), data.contact.dist.tolist(), strict=True):
            solid, obstacle = sorted(geoms, key=of.__contains__)
            if obstacle not in of or gap >= 0.0:
                continue
            names = solid_name(model, solid), obstacle_name(model, obstacle)
            if names not in seen and len(seen) < MOST_TOUCHES:
                seen.add(names)
                met = any(o.name == names[1] and o.velocity_at(time_s[frame]).fastest > MOVES_M_S for o in moving)
                text = touch_text(*names, into=bool(walked_into(met, _way_m(qpos, time_s, frame))))
                events.append(RolloutEvent(time_s=float(time_s[frame]), kind="touch", text=text, solids=names))
        if solids:
            gaps = (mujoco.mj_geomDistance(model, data, s, o, FAR_M, None) for s in solids for o in obstacles)
            clearance[frame] = min(gaps)
    return Touched(events, clearance)


def _way_m(qpos: NDArray[np.float64], time_s: NDArray[np.floating], frame: int) -> float:
    """How far the root, first of the state, has come in the last `STANDS_S`, or since the start, horizontally [m]."""
    before = qpos[np.searchsorted(time_s, time_s[frame] - STANDS_S - 1e-6)]
    return float(np.linalg.norm(qpos[frame, :2] - before[:2]))


def touch_text(solid: str, obstacle: str, into: bool) -> str:
    """A touch in words; `into`: it is no fault of the robot (`hotice.task.rules.walked_into`)."""
    return f"{obstacle} walks into {solid}: the robot stands" if into else f"{solid} touches {obstacle}"


def solid_name(model: mujoco.MjModel, geom: int) -> str:
    """Name of a moving solid, as records have it."""
    return model.geom(geom).name or f"geom_{geom}"


def obstacle_name(model: mujoco.MjModel, geom: int) -> str:
    """Name of the scene's obstacle that a geom belongs to; faces of a mesh are numbered."""
    name = model.geom(geom).name.removeprefix(OBSTACLE_PREFIX)
    return name.rpartition("#")[0] if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_MESH else name
