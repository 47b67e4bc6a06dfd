"""The two plants of a station and their adaptors: the same robot, object and scene in MuJoCo or in Drake."""

# pydrake's stubs type arrays as numpy does not:
# pyright: reportArgumentType=false

from __future__ import annotations

import copy
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import DiagramBuilder

from hotice.errors import NotAvailable
from hotice.model import builder as models
from hotice.model.dynamics import perturb
from hotice.model.joint_friction import set_friction_reference
from hotice.systems.compose import connect
from hotice.systems.drake_plant import DrakePlant
from hotice.systems.joint_pd import JointServo
from hotice.systems.mujoco_plant import MujocoPlant
from hotice.systems.pushes import Pushes
from hotice.systems.signals import torque_limits
from hotice.systems.state_adaptor import DrakeStateAdaptor, MujocoStateAdaptor

if TYPE_CHECKING:
    from hotice.systems.station.make import Station

PLANTS = ("mujoco", "drake")
Array = NDArray[np.float64]


def add_plant(builder: DiagramBuilder, station: Station, period_s: float) -> tuple[Any, Any]:
    """Adds `plant` and `state_adaptor`; the default Context starts at the station's start, at rest.

    `period_s`: for which the MuJoCo plant holds commands, at least the physics step.
    """
    carry, qpos = station.carry, station.start_qpos
    if station.plant_name == "drake":
        if station.config.push_m_s or not station.config.dynamics.nominal:
            raise NotAvailable(
                'pushes and uncertain dynamics are simulated by plant="mujoco" alone: set push_m_s and dynamics to 0'
            )
        drake = DrakePlant(
            station.world, carry.carried, carry.wrist_pos, qpos, station.physics_dt_s, not station.torques
        )
        plant = builder.AddNamedSystem("plant", drake)
        size = plant.GetOutputPort("state").size()
        adaptor = builder.AddNamedSystem("state_adaptor", DrakeStateAdaptor(size, plant.index, carry.wrist_pos))
        connect(builder, plant, "state", adaptor, "state")
        return plant, adaptor
    robot, model = station.robot, station_model(station)
    ctrl = np.zeros(model.nu) if station.motors else carry.joint_target
    servo = JointServo.of_model(robot) if station.motors and not station.torques else None
    pushed = station.config.push_m_s > 0
    plant = builder.AddNamedSystem("plant", MujocoPlant(model, qpos, ctrl, period_s, servo, pushed))
    if pushed:
        config = station.config
        pushes = Pushes(config.push_m_s, config.push_interval_s, station.task.control_dt_s, config.seed)
        connect(builder, builder.AddNamedSystem("pushes", pushes), "push", plant, "push")
    adaptor = builder.AddNamedSystem("state_adaptor", MujocoStateAdaptor(plant.size, plant.first, carry.wrist_pos))
    connect(builder, plant, "full_state", adaptor, "full_state")
    return plant, adaptor


def station_model(station: Station) -> mujoco.MjModel:
    """The compiled model of a station: position servos where the motors have them, else motors that take torques."""
    model = copy.copy(station.robot)
    if station.motors:
        to_motors(model, model.actuator_forcerange[:, 1] / torque_limits() if station.torques else 1.0)
    return model


def station_robot(station: Station) -> mujoco.MjModel:
    """Compiled model of a station with position servos, its parameters drawn from the station's dynamics and seed."""
    carry, config = station.carry, station.config
    model = models.build_model(
        carry.carried,
        station.world,
        wrist_pos=carry.wrist_pos,
        timestep_s=station.physics_dt_s,
        elliptic=config.elliptic,
    )
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET  # a diverged state must stay visible
    return (
        model if config.dynamics.nominal else perturb(model, config.dynamics, np.random.default_rng([config.seed, 1]))
    )


def carry_servo(station: Station) -> JointServo:
    """Gains, limits and encoders, in torques as they are commanded, of joints that a servo in the diagram drives."""
    return JointServo.of_g1() if station.config.dynamics.nominal else JointServo.commanding(station.robot)


def to_motors(model: mujoco.MjModel, strength: Array | float = 1.0) -> None:
    """Makes the position servos of a model of `build_model` motors: controls are torques [N m], limited as before.

    `strength` (20,): torque that a motor gives per unit commanded.
    """
    model.actuator_gainprm[:, 0] = strength
    model.actuator_biastype[:] = mujoco.mjtBias.mjBIAS_NONE
    model.actuator_biasprm[:] = 0.0
    set_friction_reference(model)
