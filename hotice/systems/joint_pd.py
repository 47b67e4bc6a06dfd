"""Joint servos: τ = kp (q* − q) − kd q̇, cut at the torque limit."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from hotice.model import g1
from hotice.systems.signals import JOINT_POS, JOINT_VEL, NUM_JOINTS, ROBOT_STATE, torque_limits

Array = NDArray[np.float64]


def pd_torque(target: Array, q: Array, qd: Array, kp: Array, kd: Array, limit: Array) -> Array:
    """Torques (20,) [N m] of targets and angles (20,) [rad], velocities (20,) [rad/s], gains and limits (20,)."""
    torque = kp * (target - q)
    torque -= kd * qd
    return np.minimum(np.maximum(torque, -limit, out=torque), limit, out=torque)


class JointPd(LeafSystem):
    """Inputs `joint_target` (20,) [rad] and `robot_state` (84,); output `torque` (20,) [N m]: gains of `g1.gains`."""

    def __init__(self) -> None:
        super().__init__()
        self.kp, self.kd = g1.gains()
        self.limit = torque_limits()
        self.DeclareVectorInputPort("joint_target", NUM_JOINTS)
        self.DeclareVectorInputPort("robot_state", ROBOT_STATE)
        self.DeclareVectorOutputPort("torque", NUM_JOINTS, self._output)

    def _output(self, context: Context, output: BasicVector) -> None:
        target = self.get_input_port(0).Eval(context)
        state = self.get_input_port(1).Eval(context)
        output.SetFromVector(
            pd_torque(target, state[JOINT_POS], state[JOINT_VEL], self.kp, self.kd, self.limit)
        )  # fmt: skip
