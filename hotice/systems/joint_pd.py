"""Joint servos: τ = kp (q* − q) − kd q̇, cut at the torque limit."""

# pydrake's stubs type arrays as numpy does not:
# pyright: reportArgumentType=false

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import Adder, ConstantVectorSource, Demultiplexer, Gain, Saturation

from hotice.model import g1
from hotice.model.dynamics import joint_offset
from hotice.model.joint_limits import torque_limits
from hotice.model.motors import motor_strength
from hotice.systems.signals import NUM_JOINTS

Array = NDArray[np.float64]


def pd_torque(target: Array, q: Array, qd: Array, kp: Array, kd: Array, limit: Array) -> Array:
    """Torques (20,) [N m] of targets and angles (20,) [rad], velocities (20,) [rad/s], gains and limits (20,)."""
    torque = kp * (target - q)
    torque -= kd * qd
    return np.minimum(np.maximum(torque, -limit, out=torque), limit, out=torque)


@dataclass(frozen=True, kw_only=True, eq=False)
class JointServo:
    """Gains kp [N m/rad], kd [N m s/rad], torque limit [N m] and encoder error [rad] of actuated joints, (20,) each."""

    kp: Array
    kd: Array
    limit: Array
    offset: Array

    @classmethod
    def of_g1(cls) -> JointServo:
        """Servo of `g1.gains` and the robot's description."""
        kp, kd = g1.gains()
        return cls(kp=kp, kd=kd, limit=torque_limits(g1.ACTION_JOINTS), offset=np.zeros(NUM_JOINTS))

    @classmethod
    def of_model(cls, model: mujoco.MjModel) -> JointServo:
        """Servo like the position servos of a model of `builder.build_model`, perturbed or not."""
        return cls(
            kp=model.actuator_gainprm[:, 0].copy(),
            kd=-model.actuator_biasprm[:, 2],
            limit=model.actuator_forcerange[:, 1].copy(),
            offset=joint_offset(model),
        )

    @classmethod
    def commanding(cls, model: mujoco.MjModel) -> JointServo:
        """The same around motors of the drawn strength, in torques as commanded.

        See `hotice.model.motors.to_motors`.
        """
        servo = cls.of_model(model)
        strength = motor_strength(model)
        return cls(kp=servo.kp / strength, kd=servo.kd / strength, limit=servo.limit / strength, offset=servo.offset)


class JointPd(Diagram):
    """Inputs `joint_target` (20,) [rad] and `joint_state` (40,) q [rad], q̇ [rad/s]; output `torque` (20,) [N m].

    `servo`: default those of `g1.gains`; what it reads is off by its offset. Made of Drake's own blocks, so that the
    torque loop runs without Python; bit for bit `pd_torque`.
    """

    def __init__(self, servo: JointServo | None = None) -> None:
        Diagram.__init__(self)
        servo = servo or JointServo.of_g1()
        off = bool(servo.offset.any())
        builder = DiagramBuilder()
        split = builder.AddNamedSystem("split", Demultiplexer([NUM_JOINTS, NUM_JOINTS]))
        minus = builder.AddNamedSystem("minus", Gain(-1.0, NUM_JOINTS))
        error = builder.AddNamedSystem("error", Adder(2 + off, NUM_JOINTS))
        stiffness = builder.AddNamedSystem("stiffness", Gain(servo.kp))
        damping = builder.AddNamedSystem("damping", Gain(-servo.kd))
        total = builder.AddNamedSystem("total", Adder(2, NUM_JOINTS))
        cut = builder.AddNamedSystem("cut", Saturation(-servo.limit, servo.limit))
        builder.ExportInput(error.get_input_port(0), "joint_target")
        builder.ExportInput(split.get_input_port(0), "joint_state")
        builder.Connect(split.get_output_port(0), minus.get_input_port())
        builder.Connect(minus.get_output_port(), error.get_input_port(1))
        if off:
            encoder = builder.AddNamedSystem("encoder", ConstantVectorSource(-servo.offset))
            builder.Connect(encoder.get_output_port(), error.get_input_port(2))
        builder.Connect(error.get_output_port(), stiffness.get_input_port())
        builder.Connect(split.get_output_port(1), damping.get_input_port())
        builder.Connect(stiffness.get_output_port(), total.get_input_port(0))
        builder.Connect(damping.get_output_port(), total.get_input_port(1))
        builder.Connect(total.get_output_port(), cut.get_input_port())
        builder.ExportOutput(cut.get_output_port(), "torque")
        builder.BuildInto(self)
