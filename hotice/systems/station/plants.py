"""The two plants of a station and their adaptors: the same robot, object and scene in MuJoCo or in Drake."""

# pydrake's stubs type arrays as numpy does not:
# pyright: reportArgumentType=false

from __future__ import annotations

from typing import Any

import numpy as np
from pydrake.systems.framework import DiagramBuilder

from hotice.errors import NotAvailable
from hotice.systems.compose import connect
from hotice.systems.drake_plant import DrakePlant
from hotice.systems.joint_pd import JointServo
from hotice.systems.mujoco_plant import MujocoPlant
from hotice.systems.pushes import Pushes
from hotice.systems.setup.setup import StationSetup
from hotice.systems.state_adaptor import DrakeStateAdaptor, MujocoStateAdaptor


def add_plant(builder: DiagramBuilder, setup: StationSetup, period_s: float) -> tuple[Any, Any]:
    """Adds `plant` and `state_adaptor`; the default Context starts at the station's start, at rest.

    `period_s`: for which the MuJoCo plant holds commands, at least the physics step.
    """
    carry, qpos = setup.carry, setup.start_qpos
    if setup.plant_name == "drake":
        if setup.world.moving:
            raise NotAvailable(
                f'scene {setup.scene.name!r}: obstacles that move are simulated by plant="mujoco" alone: choose that '
                "plant, or a scene without motions"
            )
        if setup.config.push_m_s or not setup.config.dynamics.nominal:
            raise NotAvailable(
                'pushes and uncertain dynamics are simulated by plant="mujoco" alone: set push_m_s and dynamics to 0'
            )
        drake = DrakePlant(setup.world, carry.carried, carry.wrist_pos, qpos, setup.physics_dt_s, not setup.torques)
        plant = builder.AddNamedSystem("plant", drake)
        size = plant.GetOutputPort("state").size()
        adaptor = builder.AddNamedSystem("state_adaptor", DrakeStateAdaptor(size, plant.index, carry.wrist_pos))
        connect(builder, plant, "state", adaptor, "state")
        return plant, adaptor
    robot, model = setup.robot, setup.model()
    ctrl = np.zeros(model.nu) if setup.motors else carry.joint_target
    servo = JointServo.of_model(robot) if setup.motors and not setup.torques else None
    pushed = setup.config.push_m_s > 0
    plant = builder.AddNamedSystem("plant", MujocoPlant(model, qpos, ctrl, period_s, servo, pushed, setup.world.moving))
    if pushed:
        config = setup.config
        pushes = Pushes(config.push_m_s, config.push_interval_s, setup.task.control_dt_s, config.seed)
        connect(builder, builder.AddNamedSystem("pushes", pushes), "push", plant, "push")
    adaptor = builder.AddNamedSystem("state_adaptor", MujocoStateAdaptor(plant.size, plant.first, carry.wrist_pos))
    connect(builder, plant, "full_state", adaptor, "full_state")
    return plant, adaptor
