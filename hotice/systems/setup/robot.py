"""A station's robot: its model with the object in its world, parameters drawn, and where it starts."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from hotice.model import builder
from hotice.model.carry import CarryState
from hotice.model.dynamics import perturb
from hotice.model.frames import quat_from_yaw, quat_mul, quat_rotate
from hotice.model.scene import Scene
from hotice.systems.setup.config import StationConfig

Array = NDArray[np.floating]


def drawn_robot(config: StationConfig, world: Scene, carry: CarryState, physics_dt_s: float) -> mujoco.MjModel:
    """The compiled model with position servos; its parameters are drawn from the configuration's dynamics and seed."""
    model = builder.build_model(
        carry.carried, world, wrist_pos=carry.wrist_pos, timestep_s=physics_dt_s, elliptic=config.elliptic
    )
    # a diverged state must stay visible
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
    if config.dynamics.nominal:
        return model
    return perturb(model, config.dynamics, np.random.default_rng([config.seed, 1]))


def standing_qpos(carry: CarryState, start: tuple[float, float, float]) -> Array:
    """Configuration (34,) of a carry state moved to a start: x, y [m], yaw [rad] of the pelvis."""
    turn, offset = quat_from_yaw(start[2]), np.array([start[0], start[1], 0.0])
    pelvis = carry.root_pos_W * [0.0, 0.0, 1.0] + offset
    arm_W = quat_rotate(turn, carry.object_pos_W - carry.root_pos_W)
    return np.concatenate(
        [pelvis, quat_mul(turn, carry.quat_WP), carry.joint_pos, pelvis + arm_W, quat_mul(turn, carry.quat_WO)]
    )
