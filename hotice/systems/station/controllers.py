"""The controllers of a station: from what the robot perceives to the command of its motors."""

# pydrake's stubs type arrays as numpy does not:
# pyright: reportArgumentType=false

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import DiagramBuilder, LeafSystem, System

from hotice.errors import NotAvailable, PickInfeasible
from hotice.model.carry import CarryState
from hotice.model.frames import quat_from_yaw, quat_mul, quat_rotate
from hotice.systems.compose import connect
from hotice.systems.controller_system import ControllerSystem
from hotice.systems.hand_over.mode_selector import HandOver, ModeSelector
from hotice.systems.hand_over.rehearsal import Rehearsal
from hotice.systems.hand_over.walk_rehearsal import WalkRehearsal
from hotice.systems.joint_pd import JointPd
from hotice.systems.policy import PolicySystem
from hotice.systems.setup.table import pick_origin
from hotice.systems.station.plants import carry_servo

if TYPE_CHECKING:
    from hotice.systems.setup.config import StationConfig
    from hotice.systems.station.make import Station

CONTROLLERS = ("policy", "hold", "walk", "pickup", "pickup_then_policy")
"""hold: the carry state's joint targets, without a policy: standing with the object."""
TORQUE_CONTROLLERS = ("walk", "pickup", "pickup_then_policy")
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
    """What controllers may read: systems and the names of their ports."""

    robot_state: Source
    joint_state: Source
    contact_force: Source
    percept: Source
    guidance: Source


@dataclass(frozen=True, kw_only=True, eq=False)
class PickSetting:
    """A pick-up before it begins, in W.

    controller: of `hotice.control.pickup`; carry: the state in which it leaves the object; origin: x, y [m], yaw [rad]
    of its frame; qpos: (34,) robot and object, in MuJoCo's order.
    """

    controller: Any
    carry: CarryState
    origin: tuple[float, float, float]
    qpos: Array


def add_controller(builder: DiagramBuilder, station: Station, sensed: Sensed, latency_s: float) -> Source:
    """Adds what the station's controller needs; returns where its command comes out (see `Station.torques`)."""
    kind = station.controller_name
    if kind == "walk":
        return _add_walk(builder, station, sensed), "torque"
    if kind == "pickup":
        return _add_pickup(builder, station, sensed), "torque"
    if kind == "pickup_then_policy":
        return _add_pickup_then_policy(builder, station, sensed, latency_s), "torque"
    if kind == "policy":
        target: System = _add_policy(builder, station, sensed, latency_s)
    else:
        target = builder.AddNamedSystem("hold", HeldPosture(station.carry.joint_target))
    return (_add_servo(builder, station, target, sensed), "torque") if station.torques else (target, "joint_target")


def _add_policy(builder: DiagramBuilder, station: Station, sensed: Sensed, latency_s: float) -> System:
    policy = builder.AddNamedSystem("policy", PolicySystem(station.policy, station.carry, latency_s))
    connect(builder, *sensed.percept, policy, "percept")
    connect(builder, *sensed.guidance, policy, "guidance")
    return policy


def _add_servo(builder: DiagramBuilder, station: Station, target: System, sensed: Sensed) -> System:
    servo = builder.AddNamedSystem("joint_pd", JointPd(carry_servo(station)))
    connect(builder, target, "joint_target", servo, "joint_target")
    connect(builder, *sensed.joint_state, servo, "joint_state")
    return servo


def _add_steps(builder: DiagramBuilder, name: str, system: ControllerSystem, sensed: Sensed) -> ControllerSystem:
    builder.AddNamedSystem(name, system)
    connect(builder, *sensed.robot_state, system, "robot_state")
    connect(builder, *sensed.contact_force, system, "contact_force")
    return system


def _add_walk(builder: DiagramBuilder, station: Station, sensed: Sensed) -> System:
    from hotice.control.walk import WalkController

    controller = WalkController(station.walk_plan, station.carry)
    return _add_steps(builder, "walk", ControllerSystem(controller, WALK_PHASES, station.carry.torque), sensed)


def _add_pickup(builder: DiagramBuilder, station: Station, sensed: Sensed) -> System:
    from hotice.control.pickup import PHASES

    pick = station.pick or plan_pick(station)
    system = ControllerSystem(pick.controller, PHASES, np.zeros(20), pick.origin)
    return _add_steps(builder, "pickup", system, sensed)


def _add_pickup_then_policy(builder: DiagramBuilder, station: Station, sensed: Sensed, latency_s: float) -> System:
    from hotice.control.pickup import PHASES

    pickup = _add_pickup(builder, station, sensed)
    policy = _add_policy(builder, station, sensed, latency_s)
    servo = _add_servo(builder, station, policy, sensed)
    rule = HandOver(ready_phase=PHASES.index("hold"))
    walk = _add_walk_later(builder, station, sensed)
    tried = station.config.rehearsal
    rehearsal = Rehearsal(station, tried) if tried.horizon_s else None
    of_walk = WalkRehearsal(station, tried) if tried.horizon_s else None
    selector = builder.AddNamedSystem(
        "mode_selector", ModeSelector(rule, station.task.control_dt_s, rehearsal, of_walk)
    )
    connect(builder, pickup, "torque", selector, "pickup_torque")
    connect(builder, servo, "torque", selector, "carry_torque")
    connect(builder, pickup, "phase", selector, "phase")
    connect(builder, *sensed.contact_force, selector, "contact_force")
    if rehearsal is not None:
        connect(builder, walk, "torque", selector, "walk_torque")
        connect(builder, *sensed.robot_state, selector, "robot_state")
    connect(builder, selector, "carry_active", policy, "active")
    connect(builder, selector, "walk_active", walk, "active")
    return selector


def _add_walk_later(builder: DiagramBuilder, station: Station, sensed: Sensed) -> System:
    from hotice.control.walk.later import WalkLater

    controller = WalkLater(station.pf, station.carry)
    return _add_steps(builder, "walk", ControllerSystem(controller, WALK_PHASES, station.carry.torque), sensed)


def plan_pick(station: Station) -> PickSetting:
    """The robot before the table and the plan to pick the station's object up from it.

    Raises `HoticeError` for an object or a table that the pick-up refuses, `NotAvailable` without the pick-up.
    """
    try:
        from hotice.control.pick_plan import Support
        from hotice.control.pickup import Pickup
        from hotice.control.pickup.end_state import end_state
    except ModuleNotFoundError as error:
        raise NotAvailable(
            f"controller {station.controller_name!r} needs {error.name}, which is not installed"
        ) from None
    config, carried = station.config, station.config.carried
    origin = pick_origin(station.scene, config)
    try:
        support = Support(top_m=config.support_height_m, near_m=config.support_near_m)
    except PickInfeasible as error:
        raise _out_of_reach(config, error) from None
    half = carried.half_extents_m
    p_GO = np.array([support.near_m + 0.02 + half[0], 0.0, support.top_m + half[2]])
    upright = np.array([1.0, 0.0, 0.0, 0.0])
    departure = None
    if station.controller_name == "pickup_then_policy":
        from hotice.systems.setup.departure import plan_departure

        departure = plan_departure(station.pf, station.task, station.carry, origin)
    try:
        controller = Pickup(carried, support, p_GO, upright, departure=departure)
    except PickInfeasible as error:
        raise _out_of_reach(config, error) from None
    turn, offset = quat_from_yaw(origin[2]), np.array([*origin[:2], 0.0])
    q = controller.start_q
    qpos = np.concatenate(
        [
            quat_rotate(turn, q[:3]) + offset,
            quat_mul(turn, np.roll(q[3:7], 1)),
            q[7:27],
            quat_rotate(turn, p_GO) + offset,
            quat_mul(turn, upright),
        ]
    )
    return PickSetting(controller=controller, carry=end_state(controller), origin=origin, qpos=qpos)


def _out_of_reach(config: StationConfig, why: PickInfeasible) -> PickInfeasible:
    return PickInfeasible(
        f"the {config.carried.shape} cannot be picked up with support_height_m {config.support_height_m:g} and "
        f"support_near_m {config.support_near_m:g}: {why}; move the support (0.25 m before the feet and 0.5 to 0.7 m "
        "high suit most objects)"
    )
