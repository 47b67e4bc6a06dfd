"""Motors of a simulated robot: the law of the robot's own, τ = tau + kp (q* − q) + kd (dq* − dq), inside the actuators.

Gains and targets of each message become gain and bias of MuJoCo's actuators, so that damping is integrated implicitly.
The same law computed as a torque every 2 ms chatters at kd 8 (200 changes of sign a second).
"""

from __future__ import annotations

from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from hotice.model import g1
from hotice.model.dynamics import joint_offset
from hotice.model.joint_friction import set_friction_reference
from hotice.model.joint_limits import torque_limits

Array = NDArray[np.float64]
JOINTS = len(g1.ALL_JOINTS)


class MotorCommand(NamedTuple):
    """What motors are told, each (29,) in the order of `g1.ALL_JOINTS`: [rad], [rad/s], [N m], gains, on or off."""

    q: ArrayLike
    dq: ArrayLike
    tau: ArrayLike
    kp: ArrayLike
    kd: ArrayLike
    on: ArrayLike


_ZERO = np.zeros(JOINTS)
LIMP = MotorCommand(_ZERO, _ZERO, _ZERO, _ZERO, _ZERO, np.zeros(JOINTS, bool))
"""All motors off."""


class Motors:
    """The 29 position servos of a model of `build_model`, commanded anew with every message; changes the model.

    Gains, strength and encoder offsets that `hotice.model.dynamics.perturb` drew stay at work as shares of what is
    commanded: a motor believes its encoder, and gives more or less torque than it is told.
    """

    def __init__(self, model: mujoco.MjModel) -> None:
        kp, kd = g1.gains(g1.ALL_JOINTS)
        self._model = model
        self._kp_share = model.actuator_gainprm[:, 0] / kp
        self._kd_share = -model.actuator_biasprm[:, 2] / kd
        self._strength = model.actuator_forcerange[:, 1] / torque_limits()
        self.offset = joint_offset(model)
        """How much more than the truth each encoder reads, (29,) [rad]."""
        self._dry = bool(model.dof_frictionloss.any())
        model.actuator_gainprm[:, 0] = 1.0
        model.actuator_biasprm[:, 0] = 0.0
        self.command(LIMP)

    def command(self, told: MotorCommand) -> None:
        """Holds from now on what it is told; motors that are off give no torque."""
        on = np.asarray(told.on, bool)
        kp = np.where(on, self._kp_share * np.asarray(told.kp, float), 0.0)
        kd = np.where(on, self._kd_share * np.asarray(told.kd, float), 0.0)
        ahead = np.where(on, self._strength * np.asarray(told.tau, float), 0.0)
        self._ctrl = ahead + kp * (np.asarray(told.q, float) - self.offset) + kd * np.asarray(told.dq, float)
        bias = self._model.actuator_biasprm
        damping_is_new = self._dry and not np.array_equal(bias[:, 2], -kd)
        bias[:, 1], bias[:, 2] = -kp, -kd
        if damping_is_new:
            set_friction_reference(self._model)

    def actuate(self, data: mujoco.MjData) -> None:
        """Puts the command into the controls of the next step."""
        data.ctrl[:] = self._ctrl
