"""Where obstacles are: their own motions lead them, or a hand, until they are put back."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hotice.model.moving.motion import FASTEST_M_S
from hotice.model.scene import Obstacle, Scene, Vec3

OBSTACLE_M_S = 2.0
"""Speed at which obstacles follow the hand that drags them [m/s] (ours): the robot meets a wall that comes, not one
that is suddenly inside it."""


class Obstacles:
    """Obstacles of a scene from the start of a walk on; `now`: where they are, by name, without motions."""

    def __init__(self, scene: Scene) -> None:
        self._planned = {obstacle.name: obstacle for obstacle in scene.obstacles}
        self._held: dict[str, Vec3] = {}
        self.now = {obstacle.name: obstacle.at(0.0) for obstacle in scene.obstacles}

    def bring(self, name: str, to_W: Vec3) -> None:
        """A hand wants one there [m], and keeps it there; those that share its motion, a person's parts, go along."""
        motion, way = self._planned[name].motion, np.subtract(to_W, self.now[name].position_m)
        for each in self.now.values() if motion else ():
            if self._planned[each.name].motion == motion:
                self._held[each.name] = tuple((each.position_m + way).tolist())
        self._held[name] = to_W

    def let_go(self) -> None:
        """All go back to where the scene has them."""
        self._held.clear()

    def restart(self) -> tuple[Obstacle, ...]:
        """Those that move are where their motion begins, but for those that a hand holds."""
        moved = {o.name: o.at(0.0) for o in self._planned.values() if o.motion and o.name not in self._held}
        self.now |= moved
        return tuple(moved.values())

    def advance(self, time_s: float, dt_s: float) -> tuple[Obstacle, ...]:
        """Those that have moved, `dt_s` [s] later, at `time_s` [s] since the start of the walk."""
        moved = {}
        for name, planned in self._planned.items():
            now = self.now[name]
            goal = replace(now, position_m=self._held[name]) if name in self._held else planned.at(time_s)
            if goal == now:
                continue
            # what moves by itself may be faster than a hand
            reach = dt_s * (FASTEST_M_S if planned.motion else OBSTACLE_M_S)
            way = np.subtract(goal.position_m, now.position_m)
            far = float(np.linalg.norm(way))
            if far > reach:
                goal = replace(goal, position_m=tuple((now.position_m + way * (reach / far)).tolist()))
            moved[name] = goal
        self.now |= moved
        return tuple(moved.values())
