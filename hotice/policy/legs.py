"""Where the pelvis has gone while nobody says: on by its gyro, and by the foot that stands."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from hotice.model import g1
from hotice.model.frames import mat_to_quat
from hotice.policy.measuring import attitude
from hotice.policy.percept import PerceptModel

Array = NDArray[np.float64]
FEET = tuple(g1.SGF_KEYPOINTS.index(f"{side}_foot") for side in g1.SIDES)
LIFTED_M = 0.02
"""The other foot stands when this one is so much higher; less is noise of the encoders (ours)."""


class Legs:
    """Carries keypoints of the robot on by one measurement; see `step`.

    Args:
        model: of the robot.
        qpos: (43,) a configuration of it, for joints that the policy does not move.
    """

    def __init__(self, model: PerceptModel, qpos: Array) -> None:
        self._model, self._qpos = model, qpos

    def step(
        self, p_WP: Array, p_WK: Array, foot: float, yaw: float, down_P: Array, q: Array
    ) -> tuple[Array, Array, int]:
        """Pelvis (3,) and keypoints (11, 3) [m] of now, and which of `FEET` stands: that foot stays where it was.

        Args:
            p_WP, p_WK: pelvis (3,) and keypoints (11, 3) of the measurement before [m].
            foot: which stood then; NaN: not known, the lower one does.
            yaw: heading of now [rad]; down_P: (3,) direction of gravity. q: (20,) measured joints [rad].
        """
        qpos = self._qpos.copy()
        qpos[g1.ROOT_POS], qpos[g1.ROOT_QUAT] = p_WP, mat_to_quat(attitude(yaw, down_P))
        now_WK = self._model.keypoints_at(qpos)(q)
        heights = [now_WK[point, 2] for point in FEET]
        stands = int(np.argmin(heights)) if math.isnan(foot) else int(foot)
        if heights[stands] - heights[1 - stands] > LIFTED_M:
            stands = 1 - stands
        shift = p_WK[FEET[stands]] - now_WK[FEET[stands]]
        return p_WP + shift, now_WK + shift, stands
