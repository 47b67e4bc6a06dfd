"""The two plants of a station and their adaptors: the same robot, object and scene in MuJoCo or in Drake."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import DiagramBuilder

from hotice.errors import InvalidConfig
from hotice.model import builder as models
from hotice.model.carry import CarryState
from hotice.model.scene import Scene
from hotice.systems.compose import connect
from hotice.systems.mujoco_plant import MujocoPlant
from hotice.systems.state_adaptor import StateAdaptor, mujoco_to_robot_state
from hotice.systems.station_config import StationConfig

PLANTS = ("mujoco", "drake")


def add_plant(
    builder: DiagramBuilder, name: str, config: StationConfig, scene: Scene, carry: CarryState, qpos: NDArray[np.float64]
) -> tuple[Any, StateAdaptor]:  # fmt: skip
    """Adds `plant` and `state_adaptor`; the default Context starts at `qpos` (34,), at rest."""
    if name == "drake":
        raise InvalidConfig("later")
    model = station_model(config, scene, carry)
    ctrl = carry.joint_target if config.servo == "motor" else np.zeros(model.nu)
    plant = builder.AddNamedSystem("plant", MujocoPlant(model, qpos, ctrl))
    convert = mujoco_to_robot_state(carry.wrist_pos)
    adaptor = builder.AddNamedSystem("state_adaptor", StateAdaptor(model.nq + model.nv, convert))
    connect(builder, plant, "state", adaptor, "state")
    return plant, adaptor


def station_model(config: StationConfig, scene: Scene, carry: CarryState) -> mujoco.MjModel:
    """The compiled model of a station: position servos where the motors have them, else motors that take torques."""
    model = models.build_model(
        carry.carried, scene, wrist_pos=carry.wrist_pos, timestep_s=config.physics_dt_s, elliptic=config.elliptic
    )
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET  # a diverged state must stay visible
    if config.servo == "pd":
        to_motors(model)
    return model


def to_motors(model: mujoco.MjModel) -> None:
    """Makes the position servos of a model of `build_model` motors: controls are torques [N m], limited as before."""
    model.actuator_gainprm[:, 0] = 1.0
    model.actuator_biastype[:] = mujoco.mjtBias.mjBIAS_NONE
    model.actuator_biasprm[:] = 0.0
