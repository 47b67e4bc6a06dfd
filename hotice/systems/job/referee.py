"""The referee of a whole job: the exact geometry of robot, object, scene and supports, in every physics step.

It reads who commands and the plant's state, not what a controller says of itself. Rules are those of
`hotice.task.rules`. The object may touch the support that it is picked up from until the carrying begins, and the
support at the goal from the put-down on; the robot may touch neither.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import mujoco
import numpy as np
from numpy.typing import NDArray

from hotice.model import builder, g1
from hotice.model.frames import quat_to_mat
from hotice.systems.hand_over.mode_selector import MODES
from hotice.systems.setup.put import GOAL_SUPPORT
from hotice.systems.setup.table import SUPPORT
from hotice.task import rules
from hotice.task.judge import Judge

if TYPE_CHECKING:
    from hotice.systems.station.make import Station

Array = NDArray[np.float64]
STAGES = ("pickup", "carry", "putdown")
STAGE_OF = dict(zip(MODES, ("pickup", "carry", "carry", "pickup", "putdown"), strict=True))
"""Stage by who commands."""
HANDS = tuple(f"{side}_wrist_yaw_link" for side in g1.SIDES)


class JobReferee:
    """Judge of states qpos (34,), qvel (32,) of a station's plant.

    touched: what touched what, of a collision. lifted: whether the object has been off its support.
    least_goal_m: of the root to the goal while it was carried.
    away_m, lean_rad, apart_m: of the object at the last look, from its place, from upright, hands off it.
    """

    def __init__(self, station: Station) -> None:
        if station.put is None:
            raise ValueError("a station of controller 'job' is needed")
        self._model = model = station.setup.model()
        self._data, self._judge = mujoco.MjData(model), Judge(model)
        self._scene_goal, self._place = np.array(station.scene.goal), station.put.p_WO
        carried, body = station.carry.carried, np.asarray(model.geom_bodyid)
        self._round, self._half_z = carried.shape == "sphere", float(carried.half_extents_m[2])
        self._top_m = station.config.support_height_m
        of = [model.body(int(b)).name for b in body]
        self._object = np.array([name == builder.OBJECT_BODY for name in of])
        names = [model.geom(i).name for i in range(model.ngeom)]
        self._obstacle = np.array([name.startswith(builder.OBSTACLE_PREFIX) for name in names])
        table = {s: f"{builder.OBSTACLE_PREFIX}{s}" for s in (SUPPORT, GOAL_SUPPORT)}
        self._free = {
            "pickup": np.array([name == table[SUPPORT] for name in names]),
            "carry": np.zeros(len(names), dtype=bool),
            "putdown": np.array([name == table[GOAL_SUPPORT] for name in names]),
        }
        self._hands = [i for i, name in enumerate(of) if name in HANDS]
        self._thing = int(np.flatnonzero(self._object)[0])
        self._of, self._names, self.touched = of, names, ""
        self.lifted, self.least_goal_m = False, np.inf
        self.away_m = self.lean_rad = self.apart_m = np.nan

    def failure(self, stage: str, qpos: Array, qvel: Array) -> str:
        """What is wrong in this state, by its name in `rules.OUTCOMES`; empty for nothing."""
        data = self._data
        data.qpos[:], data.qvel[:] = qpos, qvel
        mujoco.mj_fwdPosition(self._model, data)
        failed = self._judge.failure(data)
        height = float(qpos[g1.OBJECT_POS][2])
        # hands are not at the object before it is picked up, nor after it is put down
        if failed == "drop" and stage != "carry" and height >= rules.LOW_M:
            failed = ""
        self.lifted |= bool(height - self._half_z - self._top_m >= rules.LIFTED_M) and stage == "pickup"
        if stage == "carry":
            goal_m = float(np.linalg.norm(qpos[:2] - self._scene_goal))
            self.least_goal_m = min(self.least_goal_m, goal_m)
        return failed or self._collision(stage)

    def _collision(self, stage: str) -> str:
        data = self._data
        if not data.ncon:
            return ""
        pair = data.contact.geom
        hit = data.contact.dist < 0.0
        wall = self._obstacle[pair]
        touched = pair[hit & wall.any(axis=1) & ~wall.all(axis=1)]
        for a, b in touched:
            obstacle, other = (a, b) if self._obstacle[a] else (b, a)
            if not self._object[other]:
                self.touched = f"{self._of[other]} at {self._names[obstacle].removeprefix(builder.OBSTACLE_PREFIX)}"
                return "robot_collision"
            if not self._free[stage][obstacle]:
                self.touched = f"object at {self._names[obstacle].removeprefix(builder.OBSTACLE_PREFIX)}"
                return "object_collision"
        return ""

    def placed(self) -> bool:
        """Whether in the last state the object stands where it was to, hands off it."""
        data = self._data
        quat = data.qpos[g1.OBJECT_QUAT]
        self.away_m = float(np.linalg.norm(data.qpos[g1.OBJECT_POS] - self._place))
        up = float(np.asarray(quat_to_mat(quat))[2, 2])
        self.lean_rad = 0.0 if self._round else float(np.arccos(np.clip(up, -1.0, 1.0)))
        ends = np.zeros(6)
        self.apart_m = min(
            mujoco.mj_geomDistance(self._model, data, hand, self._thing, 1.0, ends) for hand in self._hands
        )
        return bool(rules.put_down(self.away_m, self.lean_rad, self.apart_m))
