"""Pelvis height and lean of the trunk along the way: as upright as what hangs overhead allows.

A table of postures from upright to crouched; at each station of the way the most upright one whose head, trunk and load
keep their clearance, robot by the Standard Guidance Field's signed distance, load by the Object-Centric one's, which
keeps its margin besides. The profile then changes no faster along the way than the gait can follow.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hotice.control.walk.arms import ArmTable
from hotice.control.walk.body import BodySpheres, body_spheres
from hotice.control.walk.config import WalkConfig
from hotice.control.walk.path import WalkPath
from hotice.errors import CarryInfeasible
from hotice.fields import HodPf
from hotice.model import g1
from hotice.model.carry import CarryState, Posture, solve_carry
from hotice.model.frames import quat_from_axis_angle, quat_to_mat
from hotice.model.scene import Obstacle

Array = NDArray[np.float64]
LEAN_PER_M, MOST_LEAN_RAD = 5.0, 0.55
"""Lean [rad] per metre below the walking height, and its largest: the ankles bend less when the trunk leans."""
LOW_M = 0.54
LEVEL_M = 0.01
SLOPE = 0.20
"""Steepest change of the pelvis height along the way [m/m]."""
GAIN_M = 0.005
"""Crouching that wins less clearance than this is not worth it."""
AHEAD_M, BEHIND_M = 0.10, 0.12
"""A low passage lowers the body from this far before it to this far behind it [m]."""


@dataclass(frozen=True)
class WalkPosture:
    """Pelvis height [m], lean [rad] and the spheres of body and load about the middle between the ankles."""

    height_m: float
    lean_rad: float
    body: BodySpheres


@dataclass(frozen=True, eq=False)
class PostureProfile:
    """Along the stations (S,) [m]: pelvis height (S,) [m] and lean (S,) [rad]; clearance_m: the least that is left."""

    station: Array
    height: Array
    lean: Array
    clearance_m: float

    def at(self, station: float) -> tuple[float, float]:
        """Height [m] and lean [rad]."""
        return float(np.interp(station, self.station, self.height)), float(np.interp(station, self.station, self.lean))


def lean_at(height_m: float, config: WalkConfig) -> float:
    """Lean of a posture of the table [rad]."""
    return min(MOST_LEAN_RAD, LEAN_PER_M * max(0.0, config.pelvis_height_m - height_m))


def postures(state: CarryState, arms: ArmTable, config: WalkConfig) -> list[WalkPosture]:
    """From the walking height down to a crouch, with the load held level."""
    table = []
    for height in np.arange(config.pelvis_height_m, LOW_M - 1e-9, -LEVEL_M):
        lean = lean_at(float(height), config)
        try:
            goal = solve_carry(state.carried, Posture(pelvis_height_m=float(height), lean_rad=lean))
        except CarryInfeasible:
            continue
        place, pitch = arms.object_at(lean)
        held = replace(
            goal,
            wrist_pos=state.wrist_pos,
            joint_pos=np.concatenate([goal.joint_pos[g1.LOWER], arms.at(lean)]),
            object_pos_W=goal.root_pos_W + quat_to_mat(goal.quat_WP) @ place,
            quat_WO=quat_from_axis_angle([0.0, 1.0, 0.0], np.asarray(lean + pitch)),
        )
        table.append(WalkPosture(float(height), lean, body_spheres(held)))
    return table


def plan_profile(pf: HodPf, path: WalkPath, table: list[WalkPosture], config: WalkConfig) -> PostureProfile:
    """The most upright feasible profile; where nothing fits, the posture of the largest clearance."""
    station = np.linspace(0.0, path.length_m, max(2, int(np.ceil(path.length_m / 0.02)) + 1))
    overhead = [o for o in pf.scene.obstacles if o.category == "overhead"]
    if not overhead:
        height = np.full(len(station), table[0].height_m)
        return PostureProfile(station, height, np.full(len(station), table[0].lean_rad), np.inf)
    xy, yaw = path.at(station)
    # (postures, stations)
    clearance = np.stack([_overhead(overhead, pf.margin_m - config.head_margin_m, xy, yaw, p.body) for p in table])
    ahead, behind = (round(d / (station[1] - station[0])) for d in (AHEAD_M, BEHIND_M))
    padded = np.pad(clearance, ((0, 0), (behind, ahead)), mode="edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, ahead + behind + 1, axis=1)
    clearance = windows.min(axis=2)
    enough = np.minimum(config.head_margin_m, clearance.max(axis=0) - GAIN_M)
    choice = (clearance >= enough).argmax(axis=0)
    height = np.array([p.height_m for p in table])[choice]
    drop = SLOPE * np.abs(station[:, None] - station)
    height = (height + drop).min(axis=1)
    lean = np.array([lean_at(h, config) for h in height])
    best = clearance[choice, np.arange(len(station))]
    return PostureProfile(station, height, lean, float(best.min()))


def _overhead(overhead: list[Obstacle], margin_m: float, xy: Array, yaw: Array, body: BodySpheres) -> Array:
    """Least clearance of body and load to what hangs overhead, per station, (S,) [m]; the load's beyond its margin."""
    least = np.full(len(xy), np.inf)
    c, s = np.cos(yaw)[:, None], np.sin(yaw)[:, None]
    for points, radius, margin in ((body.robot, body.radius, 0.0), (body.load, 0.0, margin_m)):
        x = xy[:, :1] + c * points[:, 0] - s * points[:, 1]
        y = xy[:, 1:] + s * points[:, 0] + c * points[:, 1]
        p = np.stack([x, y, np.broadcast_to(points[:, 2], x.shape)], axis=-1)
        for obstacle in overhead:
            least = np.minimum(least, (obstacle.signed_distance(p) - radius - margin).min(axis=1))
    return least
