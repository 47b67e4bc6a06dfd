"""Hands of somebody who moves joints of a simulated robot one after another, and keeps the others still meanwhile."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from hotice.deploy.simulated.motors import JOINTS, MotorCommand
from hotice.deploy.simulated.move import MOVE_S, Move
from hotice.deploy.simulated.world import JOINT_VEL, World
from hotice.model import g1

BY_RAD = 0.5


class Moving:
    """The hands: as stiff as the robot's own servos at their trained gains, which are integrated implicitly."""

    def __init__(self, world: World, moves: Sequence[Move]) -> None:
        self._world, self._moves = world, moves
        self._until_s = max((m.from_s + MOVE_S for m in moves), default=-math.inf)
        self._first = world.joint_pos.copy()
        zero, (kp, kd) = np.zeros(JOINTS), g1.gains(g1.ALL_JOINTS)
        self._hands = MotorCommand(zero, zero, zero, kp, kd, np.ones(JOINTS, bool))

    def act(self, time_s: float, told: MotorCommand) -> None:
        """For the next physics step; `told`: what the motors do once all is over."""
        if self._until_s == -math.inf:
            return
        if time_s >= self._until_s:
            self._until_s = -math.inf
            self._world.motors.command(told)
            return
        wished = self._first.copy()
        for move in self._moves:
            if move.from_s <= time_s < move.from_s + MOVE_S:
                wished[move.joint] += self._way(move.joint) * math.sin(math.pi * (time_s - move.from_s) / MOVE_S) ** 2
        self._world.motors.command(self._hands._replace(q=wished))

    def _way(self, joint: int) -> float:
        """How far and to which side a joint is moved: where there is more room [rad]."""
        low, high = self._world.model.jnt_range[self._world.model.dof_jntid[JOINT_VEL.start + joint]]
        return BY_RAD if high - self._first[joint] > self._first[joint] - low else -BY_RAD
