"""Position servos of a model as motors: controls are then torques."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from hotice.model import g1
from hotice.model.joint_friction import set_friction_reference
from hotice.model.joint_limits import torque_limits

Array = NDArray[np.float64]


def motor_strength(model: mujoco.MjModel) -> Array:
    """Torque that each motor gives per unit commanded, (20,): 1 unless `hotice.model.dynamics` drew the model."""
    return model.actuator_forcerange[:, 1] / torque_limits(g1.ACTION_JOINTS)


def to_motors(model: mujoco.MjModel, strength: Array | float | None = None) -> None:
    """Makes the position servos of a 20-joint model motors, in place: controls are torques [N m], limited as before.

    `strength` (20,): torque that a motor gives per unit commanded; default `motor_strength`.
    """
    model.actuator_gainprm[:, 0] = motor_strength(model) if strength is None else strength
    model.actuator_biastype[:] = mujoco.mjtBias.mjBIAS_NONE
    model.actuator_biasprm[:] = 0.0
    set_friction_reference(model)
