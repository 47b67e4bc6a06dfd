"""Stage of rehearsals: a model of robot, object, table and scene, and what counts there as a failure."""

from __future__ import annotations

import math

import mujoco
import numpy as np
from numpy.typing import NDArray

from hotice.systems.setup.setup import StationSetup
from hotice.systems.signals import JOINT_POS, JOINT_VEL, NQ
from hotice.task import rules
from hotice.task.judge import Judge

Array = NDArray[np.float64]
VERDICTS = ("fit", "fall", "drop", "robot_collision", "object_collision", "diverged", "no_way")
"""How a rehearsal ended; `fit`: nothing happened; `no_way`: the walking baseline has no plan to the goal."""


class RehearsalStage:
    """The station's model, apart from its plant. `model`: its joints have motors."""

    def __init__(self, setup: StationSetup) -> None:
        self.model = setup.model()
        self._judge = Judge(self.model, rules.falling)

    def start(self, state: Array, push_m_s: float) -> tuple[Array, Array]:
        """Configuration (34,) and velocity (32,) of a robot state (84,), its root pushed to the left."""
        qpos = np.concatenate([state[:7], state[JOINT_POS], state[36:43]])
        qvel = np.concatenate([state[NQ : NQ + 6], state[JOINT_VEL], state[NQ + 35 :]])
        yaw = 2.0 * math.atan2(state[6], state[3])
        qvel[:2] += push_m_s * np.array([-math.sin(yaw), math.cos(yaw)])
        return qpos, qvel

    def verdict(self, data: mujoco.MjData) -> int:
        """Index into `VERDICTS` of what is wrong with the present state, 0 for nothing."""
        failed = self._judge.failure(data) or self._judge.collision(data)
        return VERDICTS.index("diverged" if failed == "unstable" else failed or "fit")
