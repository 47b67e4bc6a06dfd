"""The two plants of a station and their adaptors: the same robot, object and scene in MuJoCo or in Drake."""

# pydrake's stubs type arrays as numpy does not:
# pyright: reportArgumentType=false

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np
from pydrake.systems.framework import DiagramBuilder

from hotice.model import builder as models
from hotice.systems.compose import connect
from hotice.systems.drake_plant import DrakePlant
from hotice.systems.joint_pd import JointServo
from hotice.systems.mujoco_plant import MujocoPlant
from hotice.systems.state_adaptor import DrakeStateAdaptor, MujocoStateAdaptor

if TYPE_CHECKING:
    from hotice.systems.station import Station

PLANTS = ("mujoco", "drake")


def add_plant(builder: DiagramBuilder, station: Station, period_s: float) -> tuple[Any, Any]:
    """Adds `plant` and `state_adaptor`; the default Context starts at the station's start, at rest.

    `period_s`: for which the MuJoCo plant holds commands, at least the physics step.
    """
    carry, qpos = station.carry, station.start_qpos
    if station.plant_name == "drake":
        drake = DrakePlant(
            station.world, carry.carried, carry.wrist_pos, qpos, station.physics_dt_s, not station.torques
        )  # fmt: skip
        plant = builder.AddNamedSystem("plant", drake)
        size = plant.GetOutputPort("state").size()
        adaptor = builder.AddNamedSystem("state_adaptor", DrakeStateAdaptor(size, plant.index, carry.wrist_pos))
        connect(builder, plant, "state", adaptor, "state")
        return plant, adaptor
    model = station_model(station)
    ctrl = np.zeros(model.nu) if station.motors else carry.joint_target
    servo = JointServo.of_g1() if station.motors and not station.torques else None
    plant = builder.AddNamedSystem("plant", MujocoPlant(model, qpos, ctrl, period_s, servo))
    adaptor = builder.AddNamedSystem("state_adaptor", MujocoStateAdaptor(plant.size, plant.first, carry.wrist_pos))
    connect(builder, plant, "full_state", adaptor, "full_state")
    return plant, adaptor


def station_model(station: Station) -> mujoco.MjModel:
    """The compiled model of a station: position servos where the motors have them, else motors that take torques."""
    carry = station.carry
    model = models.build_model(
        carry.carried, station.world, wrist_pos=carry.wrist_pos, timestep_s=station.physics_dt_s,
        elliptic=station.config.elliptic,
    )  # fmt: skip
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET  # a diverged state must stay visible
    if station.motors:
        to_motors(model)
    return model


def to_motors(model: mujoco.MjModel) -> None:
    """Makes the position servos of a model of `build_model` motors: controls are torques [N m], limited as before."""
    model.actuator_gainprm[:, 0] = 1.0
    model.actuator_biastype[:] = mujoco.mjtBias.mjBIAS_NONE
    model.actuator_biasprm[:] = 0.0
