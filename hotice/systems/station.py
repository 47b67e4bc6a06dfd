"""`make_station`: plant, sensors, fields, controller and safety joined into one Diagram, for simulation and analysis.

    plant ─ state_adaptor ─ sensor_model ─ guidance_field ─ policy ─ joint_pd ─ safety_monitor ─ plant

Time steps: plant, servo and safety at `physics_dt_s`; sensors, fields and policy at the policy's control period.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import Diagram, DiagramBuilder, LeafSystem, System

from hotice.errors import InvalidConfig, NotAvailable, UnknownName
from hotice.fields import build_hod_pf
from hotice.model import load_scene
from hotice.model.carry import CarryState, Posture, solve_carry
from hotice.model.frames import quat_from_yaw, quat_mul, quat_rotate
from hotice.policies import PolicyTask, open_policy
from hotice.systems.compose import build, connect
from hotice.systems.guidance_field import GuidanceFieldSystem
from hotice.systems.joint_pd import JointPd
from hotice.systems.policy import PolicySystem
from hotice.systems.recording import add_loggers
from hotice.systems.safety_monitor import SafePosture, SafetyMonitor
from hotice.systems.sensor_model import SensorModel, draw_delays
from hotice.systems.station_config import StationConfig
from hotice.systems.station_plant import PLANTS, add_plant
from hotice.systems.visualizer import Visualizer

CONTROLLERS = ("policy", "hold", "walk", "pickup", "pickup_then_policy")
"""hold: the carry state's joint targets, without a policy: standing with the object."""
FINE_DT_S = 0.002
"""Physics step but where the policy meets the plant that it was trained in [s]."""
Array = NDArray[np.float64]


class Station(Diagram):
    """The diagram, and what it was made of: config, scene, pf (fields), carry (state), plant and controller names."""

    def __init__(self, config: StationConfig, plant: str, controller: str, meshcat: Any) -> None:
        Diagram.__init__(self)
        self.config, self.plant_name, self.controller_name = config, plant, controller
        self.scene = load_scene(config.scene)
        self.carry = solve_carry(config.carried, Posture(pelvis_height_m=config.pelvis_height_m))
        self.pf = build_hod_pf(self.scene)
        self.policy = open_policy(config.policy)
        self.task = PolicyTask.from_meta(self.policy.meta, self.policy.name)
        trained = plant == "mujoco" and controller == "policy" and config.servo == "motor"
        self.physics_dt_s = _physics_step(config, self.task, trained)
        builder = DiagramBuilder()
        self._assemble(builder, meshcat)
        build(builder, self)
        self.set_name("station")

    def _assemble(self, builder: DiagramBuilder, meshcat: Any) -> None:
        config, dt = self.config, self.task.control_dt_s
        late, latency_s = draw_delays(config.sensing, dt, self.task.substeps, config.seed)
        qpos = start_qpos(self.carry, self.scene.start)
        period_s = dt if config.servo == "motor" and not latency_s else self.physics_dt_s
        plant, adaptor = add_plant(builder, self.plant_name, self, qpos, period_s)
        sensors = _add(builder, "sensor_model", SensorModel(config.carried, config.sensing, dt, config.seed, late))
        fields = _add(builder, "guidance_field", GuidanceFieldSystem(self.pf, self.task))
        connect(builder, adaptor, "robot_state", sensors, "robot_state")
        connect(builder, sensors, "percept", fields, "percept")
        if self.controller_name == "policy":
            target = _add(builder, "policy", PolicySystem(self.policy, self.carry, latency_s))
            connect(builder, sensors, "percept", target, "percept")
            connect(builder, fields, "guidance", target, "guidance")
        else:
            target = _add(builder, "hold", HeldPosture(self.carry.joint_target))
        torques = config.servo == "pd"
        safety = _add(builder, "safety_monitor", SafetyMonitor(SafePosture.of(self.carry), config.safety, dt, torques))
        connect(builder, adaptor, "robot_state", safety, "robot_state")
        if torques:
            servo = _add(builder, "joint_pd", JointPd())
            connect(builder, target, "joint_target", servo, "joint_target")
            connect(builder, adaptor, "joint_state", servo, "joint_state")
            connect(builder, servo, "torque", safety, "command")
        else:
            connect(builder, target, "joint_target", safety, "command")
        connect(builder, safety, "command", plant, "actuation")
        if config.log_hz:
            add_loggers(builder, 1.0 / config.log_hz)
        if meshcat is not None:
            view = Visualizer(meshcat, self.scene, self.carry.carried, config.meshcat_hz)
            _add(builder, "visualizer", view)
            for source, port in (
                (adaptor, "robot_state"),
                (sensors, "percept"),
                (fields, "guidance"),
                (plant, "contact_force"),
            ):
                connect(builder, source, port, view, port)


class HeldPosture(LeafSystem):
    """Output `joint_target` (20,) [rad], constant."""

    def __init__(self, target: Array) -> None:
        super().__init__()
        self.DeclareVectorOutputPort(
            "joint_target", len(target), lambda _, output: output.SetFromVector(target), {self.nothing_ticket()}
        )


def make_station(
    config: StationConfig | None = None, *, plant: str = "mujoco", controller: str = "policy", meshcat: Any = None
) -> Station:
    """One Diagram that carries.

    Args:
        config: numbers of the station.
        plant: mujoco, or drake (a MultibodyPlant of the same robot, object and scene).
        controller: policy, hold, walk, pickup or pickup_then_policy.
        meshcat: a pydrake Meshcat to draw into; None: no visualizer.

    Raises:
        UnknownName: plant or controller.
        HoticeError: what does not go together, and files that cannot be used.
    """
    config = config or StationConfig()
    if not isinstance(config, StationConfig):
        raise InvalidConfig(f"config is {config!r}: a StationConfig is needed; read one with StationConfig.load(path)")
    if plant not in PLANTS:
        raise UnknownName("plant", plant, PLANTS)
    if controller not in CONTROLLERS:
        raise UnknownName("controller", controller, CONTROLLERS)
    if controller not in ("policy", "hold"):
        raise NotAvailable(f"controller {controller!r} is not in this version: there are policy, hold")
    return Station(config, plant, controller, meshcat)


def start_qpos(carry: CarryState, start: tuple[float, float, float]) -> Array:
    """Configuration (34,) of a carry state moved to a start: x, y [m], yaw [rad] of the pelvis."""
    turn, offset = quat_from_yaw(start[2]), np.array([start[0], start[1], 0.0])
    pelvis = carry.root_pos_W * [0.0, 0.0, 1.0] + offset
    arm_W = quat_rotate(turn, carry.object_pos_W - carry.root_pos_W)
    return np.concatenate(
        [pelvis, quat_mul(turn, carry.quat_WP), carry.joint_pos, pelvis + arm_W, quat_mul(turn, carry.quat_WO)]
    )


def _add(builder: DiagramBuilder, name: str, system: System) -> Any:
    return builder.AddNamedSystem(name, system)


def _physics_step(config: StationConfig, task: PolicyTask, trained: bool) -> float:
    step = config.physics_dt_s or (task.physics_dt_s if trained else FINE_DT_S)
    ratio = task.control_dt_s / step
    if abs(ratio - round(ratio)) > 1e-6 or ratio < 1:
        raise InvalidConfig(f"physics_dt_s is {step!r}: the control period {task.control_dt_s:g} s must be a multiple")
    return step
