"""Whether a measured state is one that a rehearsal can begin from."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hotice.model import g1
from hotice.model.frames import normalize, quat_to_mat
from hotice.model.joint_limits import position_limits
from hotice.safety import Fault, MeasurementLimits, judge
from hotice.systems.signals import JOINT_POS, JOINT_VEL, NQ, OBJECT_POS, OBJECT_QUAT, ROOT_RATE

Array = NDArray[np.float64]


def sound(state: Array, limits: MeasurementLimits | None = None) -> bool:
    """Whether a robot state (84,) is possible, and that of a robot that stands with its object at hand.

    A hand-over is decided once: one impossible number would decide it.
    """
    limits = limits or MeasurementLimits()
    if not np.isfinite(state).all() or np.abs(state[NQ:]).max() > limits.possible_speed_rad_s:
        return False
    found, numbers = np.full(len(Fault), np.inf), judge.measurement_array(limits)
    quat_WO = state[OBJECT_QUAT]
    if not abs(np.linalg.norm(quat_WO) - 1.0) <= limits.quaternion_tolerance:
        return False
    lower, upper = position_limits(g1.ACTION_JOINTS)
    judge.find_state(
        found, 0.0, state[g1.ROOT_QUAT], state[ROOT_RATE], state[JOINT_POS], state[JOINT_VEL], lower, upper, numbers
    )
    R_WO = quat_to_mat(normalize(quat_WO))
    judge.find_pose(found, 0.0, state[g1.ROOT_POS], state[OBJECT_POS], R_WO.ravel(), numbers)
    return not np.isfinite(found).any()
