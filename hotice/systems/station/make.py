"""`make_station`: plant, sensors, fields, controller and safety joined into one Diagram, for simulation and analysis.

    plant ─ state_adaptor ─ sensor_model ─ percept_guard ─ guidance_field ─ policy ─ (joint_pd) ─ safety_monitor ─ plant

Plant and torques step at `StationSetup.physics_dt_s`; sensors, fields, policy and safety at the policy's control
period; other controllers at their own rate.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np
from numpy.typing import NDArray
from pydrake.common import RandomGenerator
from pydrake.systems.framework import Context, Diagram, DiagramBuilder, System

from hotice.errors import InvalidStation
from hotice.model.dynamics import joint_offset
from hotice.systems.compose import build, connect
from hotice.systems.faulty import SIGNALS, FaultySignal, InjectedFault, Now
from hotice.systems.guidance_field import GuidanceFieldSystem
from hotice.systems.logs import add_loggers
from hotice.systems.percept_guard import PerceptGuard
from hotice.systems.pushes import Pushes
from hotice.systems.safety_monitor import SafePosture, SafetyMonitor
from hotice.systems.sensor_model import SensorModel
from hotice.systems.setup.config import StationConfig
from hotice.systems.setup.setup import StationSetup
from hotice.systems.station.controllers import Sensed, add_controller
from hotice.systems.station.moving import MoverPoses, MovingGuidance
from hotice.systems.station.plants import add_plant
from hotice.systems.visualizer import Visualizer
from hotice.task.moving import MovingConfig
from hotice.task.sensing import draw_delays

if TYPE_CHECKING:
    from hotice.control.walk.plan import WalkPlan

Array = NDArray[np.floating]
SEEDS = 2**31
"""Number of seeds that a station may draw."""
WATCHED_OF_POLICY = ("guidance",)
"""Signals that the safety monitor watches where the controller is a policy; others do not read fields."""
TOLD = ("policy", "walk", "pickup", "putdown", "mode_selector")
"""Systems that come to a stand when they are told, and the hand-over, which waits; `hold` keeps its posture whatever
it is told."""


class Station(Diagram):
    """The diagram, and what it was made of.

    Attributes:
        setup: all that was decided before. The station has its attributes too: config, plant_name, controller_name,
            scene, world, policy, task, carry, pf, pick, put, motors, torques, physics_dt_s, walk_plan, robot,
            start_qpos; see `StationSetup`.
    """

    def __init__(self, setup: StationSetup, meshcat: Any = None, faults: Sequence[InjectedFault] = ()) -> None:
        Diagram.__init__(self)
        self.setup = setup
        self.config, self.plant_name, self.controller_name = setup.config, setup.plant_name, setup.controller_name
        self.scene, self.world, self.pf = setup.scene, setup.world, setup.pf
        self.policy, self.task, self.carry, self.pick = setup.policy, setup.task, setup.carry, setup.pick
        self.put = setup.put
        self.motors, self.torques, self.physics_dt_s = setup.motors, setup.torques, setup.physics_dt_s
        builder = DiagramBuilder()
        _assemble(builder, setup, meshcat, faults)
        build(builder, self)
        self.set_name("station")

    def SetRandomContext(self, context: Context, generator: RandomGenerator) -> None:
        """Puts the station at its start, with noise and pushes of seeds drawn from `generator`.

        Robot, object, start pose and encoder errors are those of `config.seed`: they are built into the plant. Drake
        calls no Python method for a diagram around the station; call this with `GetMyMutableContextFromRoot`.
        """
        self.SetDefaultContext(context)
        for system in self.GetSystems():
            if isinstance(system, SensorModel | Pushes):
                system.reseed(system.GetMyMutableContextFromRoot(context), generator() % SEEDS)

    @property
    def walk_plan(self) -> WalkPlan:
        """See `StationSetup.walk_plan`."""
        return self.setup.walk_plan

    @property
    def robot(self) -> mujoco.MjModel:
        """See `StationSetup.robot`."""
        return self.setup.robot

    @property
    def start_qpos(self) -> Array:
        """See `StationSetup.start_qpos`."""
        return self.setup.start_qpos


def make_station(
    config: StationConfig | None = None,
    *,
    plant: str = "mujoco",
    controller: str = "policy",
    meshcat: Any = None,
    faults: Sequence[InjectedFault] = (),
) -> Station:
    """One Diagram that carries.

    Args:
        config: numbers of the station.
        plant: mujoco, or drake (a MultibodyPlant of the same robot, object and scene).
        controller: policy; hold (keeps the carry posture; nobody balances, so that it topples within seconds); walk,
            pickup (`hotice.control`); pickup_then_policy; job: the whole way, from a support to another at the goal.
        meshcat: a pydrake Meshcat to draw into; None: no visualizer.
        faults: of signals, to see what the station does about them; those of guidance for the controller `policy`
            alone.

    Raises:
        UnknownName: plant or controller.
        InvalidStation: a fault of a signal that no answer follows from.
        HoticeError: what does not go together, and files that cannot be used.
    """
    return Station(StationSetup.decide(config or StationConfig(), plant, controller), meshcat, faults)


class _Wires:
    """Signals on their way to whoever reads them, and the faults they meet there."""

    def __init__(self, builder: DiagramBuilder, faults: Sequence[InjectedFault], control_dt_s: float) -> None:
        self._builder, self._faults, self._dt_s = builder, faults, control_dt_s

    def meet(self, signal: str, source: tuple[System, str]) -> tuple[System, str]:
        """Where the signal comes out: the source itself where nothing is wrong with it."""
        here = [fault for fault in self._faults if fault.signal == signal]
        if not here:
            return source
        system = _add(self._builder, f"faulty_{signal}", FaultySignal(SIGNALS[signal], here, self._dt_s))
        connect(self._builder, *source, system, "signal")
        return system, "signal"


def _check_answered(faults: Sequence[InjectedFault], controller: str) -> None:
    """Raises `InvalidStation` for a fault of a signal that is not watched under this controller."""
    for fault in faults:
        if controller != "policy" and fault.signal in WATCHED_OF_POLICY:
            raise InvalidStation(
                f"a fault of {fault.signal} is answered under controller='policy' alone, not under {controller!r}: "
                f"inject one of {', '.join(name for name in SIGNALS if name not in WATCHED_OF_POLICY)}"
            )


def _add_fields(builder: DiagramBuilder, setup: StationSetup) -> System:
    """Adds `guidance_field`, and `mover_poses` where it needs to know what moves."""
    moving, config = setup.scene.moving, setup.config.moving
    # a name has become numbers
    assert isinstance(config, MovingConfig)
    if not moving or config.known == "still":
        return _add(builder, "guidance_field", GuidanceFieldSystem(setup.pf, setup.task))
    live = config.known == "live"
    fields = _add(builder, "guidance_field", MovingGuidance(setup.pf, moving, setup.task, live))
    poses = _add(builder, "mover_poses", MoverPoses(moving, config, setup.config.sensing.exact))
    for name in ("movers", "ways"):
        connect(builder, poses, name, fields, name)
    return fields


def _assemble(builder: DiagramBuilder, setup: StationSetup, meshcat: Any, faults: Sequence[InjectedFault]) -> None:
    _check_answered(faults, setup.controller_name)
    config, dt = setup.config, setup.task.control_dt_s
    wires = _Wires(builder, faults, dt)
    late, latency_s = draw_delays(config.sensing, dt, round(dt / setup.physics_dt_s), config.seed)
    period_s = setup.physics_dt_s if setup.torques or latency_s else dt
    plant, adaptor = add_plant(builder, setup, period_s)
    measured = wires.meet("robot_state", (adaptor, "robot_state"))
    offset = None if config.dynamics.nominal else joint_offset(setup.robot)
    model = SensorModel(config.carried, config.sensing, dt, config.seed, late, offset)
    sensors = _add(builder, "sensor_model", model)
    connect(builder, *measured, sensors, "robot_state")
    guard = _add(builder, "percept_guard", PerceptGuard(setup.carry, dt, config.sensing))
    connect(builder, *wires.meet("percept", (sensors, "percept")), guard, "percept")
    connect(builder, *wires.meet("stamps", (_add(builder, "now", Now()), "stamps")), guard, "stamps")
    percept = guard, "percept"
    fields = _add_fields(builder, setup)
    connect(builder, *percept, fields, "percept")
    sensed = Sensed(
        robot_state=measured,
        joint_state=(adaptor, "joint_state"),
        percept=percept,
        contact_force=(plant, "contact_force"),
        guidance=wires.meet("guidance", (fields, "guidance")),
    )
    command, status = add_controller(builder, setup, sensed, latency_s)
    monitor = SafetyMonitor(SafePosture.of(setup.carry), config.safety, dt, setup.torques)
    safety = _add(builder, "safety_monitor", monitor)
    connect(builder, *measured, safety, "robot_state")
    connect(builder, *wires.meet("tick", (adaptor, "tick")), safety, "tick")
    connect(builder, *wires.meet("command", command), safety, "command")
    if status is not None:
        connect(builder, *status, safety, "status")
    connect(builder, *sensed.percept, safety, "watched_percept")
    connect(builder, guard, "sources", safety, "sources")
    if setup.controller_name == "policy":
        connect(builder, *sensed.guidance, safety, "watched_guidance")
    for system in builder.GetSystems():
        if system.get_name() in TOLD:
            connect(builder, safety, "answer", system, "answer")
    connect(builder, safety, "command", plant, "actuation")
    connect(builder, safety, "damped", plant, "damped")
    if config.log_hz:
        add_loggers(builder, 1.0 / config.log_hz)
    if meshcat is not None:
        steps = setup.walk_plan.footsteps if setup.controller_name == "walk" else ()
        view = Visualizer(
            meshcat,
            setup.world,
            setup.carry.carried,
            config.meshcat_hz,
            [(s.x, s.y, s.yaw, s.foot) for s in steps] or None,
        )
        _add(builder, "visualizer", view)
        for name in ("robot_state", "percept", "guidance", "contact_force"):
            source, port = getattr(sensed, name)
            connect(builder, source, port, view, name)


def _add(builder: DiagramBuilder, name: str, system: System) -> Any:
    return builder.AddNamedSystem(name, system)
