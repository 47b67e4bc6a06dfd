"""The controllers of a station: from what the robot perceives to the command of its motors."""

# pydrake's stubs type arrays as numpy does not:
# pyright: reportArgumentType=false

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import DiagramBuilder, LeafSystem, System

from hotice.model import g1
from hotice.systems.compose import connect
from hotice.systems.controller_system import ControllerSystem
from hotice.systems.hand_over.mode_selector import HandOver, ModeSelector
from hotice.systems.hand_over.rehearsal import Rehearsal
from hotice.systems.hand_over.walk_rehearsal import WalkRehearsal
from hotice.systems.joint_pd import JointPd
from hotice.systems.policy import PolicySystem
from hotice.systems.setup.setup import StationSetup

if TYPE_CHECKING:
    from hotice.systems.setup.pick import PickSetting
    from hotice.systems.setup.put import PutSetting

WALK_PHASES = ("shift", "swing", "double", "stand")
Array = NDArray[np.floating]
Source = tuple[System, str]


class HeldPosture(LeafSystem):
    """Output `joint_target` (20,) [rad], constant."""

    def __init__(self, target: Array) -> None:
        super().__init__()
        self.DeclareVectorOutputPort(
            "joint_target", len(target), lambda _, output: output.SetFromVector(target), {self.nothing_ticket()}
        )


@dataclass(frozen=True, kw_only=True)
class Sensed:
    """Sources that controllers may read: systems and the names of their ports."""

    robot_state: Source
    joint_state: Source
    contact_force: Source
    percept: Source
    guidance: Source


def add_controller(
    builder: DiagramBuilder, setup: StationSetup, sensed: Sensed, latency_s: float
) -> tuple[Source, Source | None]:
    """Adds what the station's controller needs; returns where its command and, if it has one, its status come out.

    For the command see `StationSetup.torques`.
    """
    kind = setup.controller_name
    if kind == "walk":
        return _torque_and_status(_add_walk(builder, setup, sensed))
    if setup.pick is not None:
        pickup = _add_pickup(builder, setup.pick, sensed)
        if kind != "pickup":
            pickup = _add_hand_over(builder, setup, pickup, sensed, latency_s)
        return _torque_and_status(pickup)
    if kind == "policy":
        target: System = _add_policy(builder, setup, sensed, latency_s)
        status = target, "status"
    else:
        target, status = builder.AddNamedSystem("hold", HeldPosture(setup.carry.joint_target)), None
    if setup.torques:
        return (_add_servo(builder, setup, target, sensed), "torque"), status
    return (target, "joint_target"), status


def _torque_and_status(system: System) -> tuple[Source, Source]:
    return (system, "torque"), (system, "status")


def _add_policy(builder: DiagramBuilder, setup: StationSetup, sensed: Sensed, latency_s: float) -> System:
    system = PolicySystem(setup.policy, setup.carry, latency_s, attraction=setup.pf.params.attraction)
    policy = builder.AddNamedSystem("policy", system)
    connect(builder, *sensed.percept, policy, "percept")
    connect(builder, *sensed.guidance, policy, "guidance")
    return policy


def _add_servo(builder: DiagramBuilder, setup: StationSetup, target: System, sensed: Sensed) -> System:
    servo = builder.AddNamedSystem("joint_pd", JointPd(setup.servo()))
    connect(builder, target, "joint_target", servo, "joint_target")
    connect(builder, *sensed.joint_state, servo, "joint_state")
    return servo


def _add_steps(builder: DiagramBuilder, name: str, system: ControllerSystem, sensed: Sensed) -> ControllerSystem:
    builder.AddNamedSystem(name, system)
    connect(builder, *sensed.robot_state, system, "robot_state")
    connect(builder, *sensed.contact_force, system, "contact_force")
    return system


def _add_walk(builder: DiagramBuilder, setup: StationSetup, sensed: Sensed) -> System:
    from hotice.control.walk import WalkController

    controller = WalkController(setup.walk_plan, setup.carry)
    return _add_steps(builder, "walk", ControllerSystem(controller, WALK_PHASES, setup.carry.torque), sensed)


def _add_pickup(builder: DiagramBuilder, pick: PickSetting, sensed: Sensed) -> System:
    from hotice.control.pickup import PHASES

    system = ControllerSystem(pick.controller, PHASES, np.zeros(g1.ACTIONS), pick.origin)
    return _add_steps(builder, "pickup", system, sensed)


def _add_hand_over(
    builder: DiagramBuilder, setup: StationSetup, pickup: System, sensed: Sensed, latency_s: float
) -> System:
    from hotice.control.pickup import PHASES

    policy = _add_policy(builder, setup, sensed, latency_s)
    servo = _add_servo(builder, setup, policy, sensed)
    rule = HandOver(ready_phase=PHASES.index("hold"))
    walk = _add_walk_later(builder, setup, sensed)
    tried = setup.config.rehearsal
    rehearsal = Rehearsal(setup, tried) if tried.horizon_s else None
    of_walk = WalkRehearsal(setup, tried) if tried.horizon_s else None
    arrived = None if setup.put is None else setup.put.arrived(setup.scene)
    system = ModeSelector(rule, setup.task.control_dt_s, rehearsal, of_walk, arrived)
    selector = builder.AddNamedSystem("mode_selector", system)
    connect(builder, pickup, "torque", selector, "pickup_torque")
    connect(builder, servo, "torque", selector, "carry_torque")
    connect(builder, pickup, "phase", selector, "phase")
    connect(builder, *sensed.contact_force, selector, "contact_force")
    if rehearsal is not None:
        connect(builder, walk, "torque", selector, "walk_torque")
    if rehearsal is not None or setup.put is not None:
        connect(builder, *sensed.robot_state, selector, "robot_state")
    if setup.put is not None:
        _add_put_down(builder, setup.put, selector, sensed)
        connect(builder, selector, "pickup_active", pickup, "active")
    for name, system in (("pickup", pickup), ("carry", policy), ("walk", walk)):
        connect(builder, system, "status", selector, f"{name}_status")
    connect(builder, selector, "carry_active", policy, "active")
    connect(builder, selector, "walk_active", walk, "active")
    return selector


def _add_put_down(builder: DiagramBuilder, put: PutSetting, selector: ModeSelector, sensed: Sensed) -> None:
    from hotice.control.putdown import PUT_DOWN_PHASES

    putdown = ControllerSystem(put.controller, PUT_DOWN_PHASES, np.zeros(g1.ACTIONS))
    _add_steps(builder, "putdown", putdown, sensed)
    connect(builder, putdown, "torque", selector, "putdown_torque")
    connect(builder, putdown, "status", selector, "putdown_status")
    connect(builder, selector, "putdown_active", putdown, "active")


def _add_walk_later(builder: DiagramBuilder, setup: StationSetup, sensed: Sensed) -> System:
    from hotice.control.walk.later import WalkLater

    controller = WalkLater(setup.pf, setup.carry)
    return _add_steps(builder, "walk", ControllerSystem(controller, WALK_PHASES, setup.carry.torque), sensed)
