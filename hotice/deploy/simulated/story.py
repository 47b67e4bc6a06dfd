"""Story of a simulated robot's life: what happened to it and when, not only how it stands in the end."""

from __future__ import annotations

import math

from hotice.deploy.simulated.handing import Stage
from hotice.deploy.simulated.world import World


class Story:
    """Looks at a robot as it lives.

    Attributes:
        failed: first fall or drop, by its name in `hotice.task.rules`, and when [s]; None: none.
        touched: the first collision with an obstacle, likewise.
        given_s: when hands let go of an object that they gave [s]; None: never.
        nearest_m: least distance from the goal so far [m].
    """

    def __init__(self) -> None:
        self.failed: tuple[str, float] | None = None
        self.touched: tuple[str, float] | None = None
        self.given_s: float | None = None
        self.nearest_m = math.inf
        self._held_by_others = False

    def see(self, now_s: float, world: World, failure: str, stage: Stage) -> None:
        """A look at the robot, its `failure` at that time, and where its object is on the way to it."""
        if self.failed is None and failure:
            self.failed = failure, now_s
        if self.touched is None and world.touched:
            self.touched = world.touched, now_s
        given = stage == "gone"
        if given and self._held_by_others:
            self.given_s = now_s
        self._held_by_others = not given
        self.nearest_m = min(self.nearest_m, goal_m(world))

    def in_words(self, world: World, failure: str, stage: Stage) -> list[tuple[str, str]]:
        """Lines of a table, with how it is in the end."""
        ends = failure or "neither fallen nor dropped"
        failed = f"{ends}; first {self.failed[0]} at {self.failed[1]:.1f} s" if self.failed else ends
        if self.given_s is not None:
            given = f"given to the robot at {self.given_s:.1f} s"
        else:
            given = "in its hands from the start" if stage == "gone" else stage
        return [
            ("robot and object", failed),
            ("object", given),
            ("touched", f"{self.touched[0]} at {self.touched[1]:.1f} s" if self.touched else "no obstacle"),
            ("to the goal", f"{goal_m(world):.2f} m, at the nearest {min(self.nearest_m, goal_m(world)):.2f} m"),
        ]


def goal_m(world: World) -> float:
    """Distance of the pelvis from the scene's goal [m]."""
    x, y = world.data.qpos[:2]
    return math.hypot(x - world.scene.goal[0], y - world.scene.goal[1])
