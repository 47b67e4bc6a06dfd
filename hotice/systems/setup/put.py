"""The put-down of a job before it begins: the support at the goal, where the robot stands before it, and the plan.

The support is an obstacle of the world like any other, of its true size. The goal of carrying is the scene's, and the
support stands so far beyond it that neither the robot there nor its load are near: fields lead to the goal as they do
without it, but for what the support itself keeps away. From the goal the robot steps to the support.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hotice.control.pick_plan import Support
from hotice.control.pickup import Stance
from hotice.control.putdown import PutDown
from hotice.errors import InvalidStation, PutDownInfeasible
from hotice.model import g1
from hotice.model.frames import quat_from_yaw, quat_rotate
from hotice.model.geometry.shapes import BoxShape
from hotice.model.scene import Obstacle, Scene
from hotice.systems.setup.config import StationConfig
from hotice.systems.setup.table import TABLE_M, room_for
from hotice.task.rules import arrived

Array = NDArray[np.float64]
GOAL_SUPPORT = "goal_support"
INSET_M = 0.02
"""From the support's near edge to the object."""
BEARINGS_RAD = tuple(float(b) for b in np.radians([0, 20, -20, 40, -40, 60, -60, 90, -90]))
"""Directions from the goal in which a support may stand, the best first."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PutSetting:
    """A put-down before it begins. controller: of `hotice.control.putdown`; p_WO: (3,) where the object is to stand."""

    controller: PutDown
    p_WO: Array

    def arrived(self, scene: Scene) -> Callable[[Array, Array], bool]:
        """Whether a robot state (84,), contact forces (12,), is one at the goal that the put-down takes over from."""
        from hotice.systems.controller_system import measurement_of

        goal = np.array(scene.goal)

        def there(state: Array, force: Array) -> bool:
            if not arrived(np.linalg.norm(state[g1.ROOT_POS][:2] - goal)):
                return False
            return self.controller.catches(measurement_of(0.0, state, force))

        return there


def put_stance(scene: Scene, config: StationConfig) -> Stance:
    """Where the robot stands before the support at the goal."""
    x, y, _ = scene.start
    way = np.array(scene.goal) - [x, y]
    yaw = float(np.arctan2(way[1], way[0])) + config.put_bearing_rad
    ahead = config.put_ahead_m * np.array([np.cos(yaw), np.sin(yaw)])
    at = np.array(scene.goal) + ahead
    return Stance(float(at[0]), float(at[1]), yaw)


def goal_support(scene: Scene, config: StationConfig) -> Obstacle:
    """The support at the goal, in W."""
    stance, (depth, width), top = put_stance(scene, config), TABLE_M, config.put_height_m
    turn = quat_from_yaw(stance.yaw)
    middle = quat_rotate(turn, np.array([config.put_near_m + 0.5 * depth, 0.0, 0.5 * top])) + [stance.x, stance.y, 0.0]
    quat = tuple(float(v) for v in turn)
    shape = BoxShape((depth, width, top))
    return Obstacle(GOAL_SUPPORT, "side", shape, tuple(middle.tolist()), quat)  # type: ignore[arg-type]


def before_goal(scene: Scene, config: StationConfig) -> StationConfig:
    """The configuration with the first bearing at which the support, and the robot before it, have room at the goal.

    Raises `InvalidStation` where there is none.
    """
    for bearing in BEARINGS_RAD:
        tried = replace(config, put_bearing_rad=bearing)
        stance = put_stance(scene, tried)
        origin, body = (stance.x, stance.y, stance.yaw), (-config.put_ahead_m, -0.5 * config.put_ahead_m, 0.0)
        if not scene.obstacles or room_for(scene, origin, config.put_near_m, body):
            return tried
    raise InvalidStation(
        f"scene {scene.name!r} leaves no room for a support at its goal: "
        "set put_bearing_rad or put_ahead_m, or take a scene with more room"
    )


def plan_put(config: StationConfig, scene: Scene, grasp_above_m: float) -> PutSetting:
    """The plan to put the object down at the goal; `grasp_above_m`: how the pick-up holds it.

    Raises:
        HoticeError: an object or a support that the put-down refuses. MissingExtra: without what plans it.
    """
    half, stance = config.carried.half_extents_m, put_stance(scene, config)
    support = Support(top_m=config.put_height_m, near_m=config.put_near_m)
    p_GO = np.array([support.near_m + INSET_M + half[0], 0.0, support.top_m + half[2]])
    upright = np.array([1.0, 0.0, 0.0, 0.0])
    try:
        controller = PutDown(config.carried, support, p_GO, upright, stance=stance, grasp_above_m=grasp_above_m)
    except PutDownInfeasible as error:
        raise PutDownInfeasible(f"{error}; choose another put_height_m or put_near_m") from None
    p_WO = quat_rotate(quat_from_yaw(stance.yaw), p_GO) + [stance.x, stance.y, 0.0]
    return PutSetting(controller=controller, p_WO=np.asarray(p_WO, dtype=np.float64))
