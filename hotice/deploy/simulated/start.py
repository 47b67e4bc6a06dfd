"""Start of a simulated robot on its gantry."""

from __future__ import annotations

import numpy as np

from hotice.deploy.simulated.world import World
from hotice.model.frames import quat_from_yaw
from hotice.model.robot_state import RobotState

HANGING_M = 0.15
"""Soles above the floor; toes hang lower."""


def hang(world: World) -> None:
    """Puts the robot above the scene's start, all joints at zero, soles `HANGING_M` above the floor."""
    x, y, yaw = world.scene.start
    height_m = float(world.start.p_WP[2])
    for _ in range(2):
        world.place(
            RobotState(
                p_WP=np.array([x, y, height_m]),
                quat_WP=quat_from_yaw(yaw),
                joint_pos=np.zeros(29),
                carried=world.carry.carried,
                p_WO=world.start.p_WO,
            )
        )
        height_m += HANGING_M - world.lowest_sole_m
