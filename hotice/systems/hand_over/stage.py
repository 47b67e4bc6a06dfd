"""Stage of rehearsals: a model of robot, object, table and scene, and what counts there as a failure."""

from __future__ import annotations

import math

import mujoco
import numpy as np
from numpy.typing import NDArray

from hotice.model import g1
from hotice.systems.setup.setup import StationSetup
from hotice.systems.signals import (
    JOINT_POS,
    JOINT_VEL,
    OBJECT_POS,
    OBJECT_QUAT,
    OBJECT_RATE,
    OBJECT_VEL,
    ROOT_RATE,
    ROOT_VEL,
)
from hotice.task import rules
from hotice.task.judge import Judge

Array = NDArray[np.float64]
VERDICTS = ("fit", "fall", "drop", "robot_collision", "object_collision", "diverged", "no_way", "gave_up")
"""Outcomes of a rehearsal; `fit`: nothing happened; `no_way`: the walking baseline has no plan to the goal; `gave_up`:
policy, solver or fields raised an error."""


class RehearsalStage:
    """The station's model, apart from its plant. `model`: its joints have motors."""

    def __init__(self, setup: StationSetup) -> None:
        self.model = setup.model()
        self._judge = Judge(self.model, rules.falling)

    def start(self, state: Array, push_m_s: float) -> tuple[Array, Array]:
        """Configuration (34,) and velocity (32,) of a robot state (84,), its root pushed to the left."""
        root = (g1.ROOT_POS, g1.ROOT_QUAT)
        qpos = np.concatenate([state[part] for part in (*root, JOINT_POS, OBJECT_POS, OBJECT_QUAT)])
        qvel = np.concatenate([state[part] for part in (ROOT_VEL, ROOT_RATE, JOINT_VEL, OBJECT_VEL, OBJECT_RATE)])
        yaw = 2.0 * math.atan2(state[6], state[3])
        qvel[:2] += push_m_s * np.array([-math.sin(yaw), math.cos(yaw)])
        return qpos, qvel

    def verdict(self, data: mujoco.MjData) -> int:
        """Index into `VERDICTS` of what is wrong with the present state, 0 for nothing."""
        failed = self._judge.failure(data) or self._judge.collision(data)
        return VERDICTS.index("diverged" if failed == "unstable" else failed or "fit")
