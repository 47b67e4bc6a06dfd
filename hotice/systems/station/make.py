"""`make_station`: plant, sensors, fields, controller and safety joined into one Diagram, for simulation and analysis.

    plant ─ state_adaptor ─ sensor_model ─ guidance_field ─ policy ─ (joint_pd) ─ safety_monitor ─ plant

Plant and torques step at `Station.physics_dt_s`; sensors, fields, policy and safety at the policy's control period;
other controllers at their own rate.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import Diagram, DiagramBuilder, System

from hotice.errors import InvalidConfig, NotAvailable, UnknownName
from hotice.fields import build_hod_pf
from hotice.model import Scene, load_scene
from hotice.model.carry import CarryState, Posture, solve_carry
from hotice.model.dynamics import joint_offset
from hotice.model.frames import quat_from_yaw, quat_mul, quat_rotate
from hotice.policy import PolicyTask, open_policy
from hotice.systems.compose import build, connect
from hotice.systems.guidance_field import GuidanceFieldSystem
from hotice.systems.record.rollout import add_loggers
from hotice.systems.safety_monitor import SafePosture, SafetyMonitor
from hotice.systems.sensor_model import SensorModel, draw_delays
from hotice.systems.setup.config import StationConfig
from hotice.systems.setup.table import around_table, table_of, with_table
from hotice.systems.station.controllers import (
    CONTROLLERS,
    TORQUE_CONTROLLERS,
    Sensed,
    add_controller,
    plan_pick,
)
from hotice.systems.station.plants import PLANTS, add_plant, station_robot
from hotice.systems.visualizer import Visualizer

FINE_DT_S, CONTROLLED_DT_S = 0.002, 0.005
"""Physics step but where policies or controllers meet the plant that they were made with, and of the latter [s]."""
Array = NDArray[np.floating]


class Station(Diagram):
    """The diagram, and what it was made of.

    Attributes:
        config, plant_name, controller_name: as given.
        scene: of the config; world: the same and, for a pick-up, the table; pf: its fields, which lead around the
            table.
        carry: carry state that the policy and `hold` keep, and where they start; of a pick-up, where it ends.
        policy, task: the policy file and its constants. motors: the plant's joints have motors that take torques, else
            position servos. torques: commands to the plant are torques, not joint targets.
        pick: the pick-up's setting, or None. physics_dt_s: step of the plant [s].
    """

    def __init__(self, config: StationConfig, plant: str, controller: str, meshcat: Any) -> None:
        Diagram.__init__(self)
        self.config, self.plant_name, self.controller_name = config, plant, controller
        self.motors = controller in TORQUE_CONTROLLERS or config.servo == "pd"
        self.torques = self.motors and (controller in TORQUE_CONTROLLERS or plant == "drake")
        self.scene = self.world = config.scene if isinstance(config.scene, Scene) else load_scene(config.scene)
        self.policy = open_policy(config.policy)
        self.task = PolicyTask.from_meta(self.policy.meta, self.policy.name)
        self.physics_dt_s = _physics_step(self)
        self.carry = solve_carry(config.carried, Posture(pelvis_height_m=config.pelvis_height_m))
        picks = controller.startswith("pickup")
        if picks:
            self.world = with_table(self.scene, table_of(self.scene, config))
        self.pf = build_hod_pf(around_table(self.world), self.task.resolution_m, self.task.margin_m)
        self.pick = plan_pick(self) if picks else None
        if self.pick is not None:
            self.carry = self.pick.carry
        builder = DiagramBuilder()
        self._assemble(builder, meshcat)
        build(builder, self)
        self.set_name("station")

    @cached_property
    def walk_plan(self) -> Any:
        """Footsteps and postures to the goal. Raises `UnreachableGoal`; `NotAvailable` without the walking baseline."""
        try:
            from hotice.control.walk import plan_walk
        except ModuleNotFoundError as error:
            raise NotAvailable(f"controller 'walk' needs {error.name}, which is not installed") from None
        return plan_walk(self.pf, self.carry, self.scene.start)

    @cached_property
    def robot(self) -> mujoco.MjModel:
        """Model of robot, object and world with position servos, its parameters drawn from `config.dynamics`."""
        return station_robot(self)

    @property
    def start_qpos(self) -> Array:
        """Where the default Context starts, (34,) in MuJoCo's order."""
        return start_qpos(self.carry, self.scene.start) if self.pick is None else self.pick.qpos

    def _assemble(self, builder: DiagramBuilder, meshcat: Any) -> None:
        config, dt = self.config, self.task.control_dt_s
        late, latency_s = draw_delays(config.sensing, dt, round(dt / self.physics_dt_s), config.seed)
        period_s = self.physics_dt_s if self.torques or latency_s else dt
        plant, adaptor = add_plant(builder, self, period_s)
        offset = None if config.dynamics.nominal else joint_offset(self.robot)
        model = SensorModel(config.carried, config.sensing, dt, config.seed, late, offset)
        sensors = _add(builder, "sensor_model", model)
        fields = _add(builder, "guidance_field", GuidanceFieldSystem(self.pf, self.task))
        connect(builder, adaptor, "robot_state", sensors, "robot_state")
        connect(builder, sensors, "percept", fields, "percept")
        sensed = Sensed(
            robot_state=(adaptor, "robot_state"),
            joint_state=(adaptor, "joint_state"),
            percept=(sensors, "percept"),
            contact_force=(plant, "contact_force"),
            guidance=(fields, "guidance"),
        )
        source, port = add_controller(builder, self, sensed, latency_s)
        monitor = SafetyMonitor(SafePosture.of(self.carry), config.safety, dt, self.torques)
        safety = _add(builder, "safety_monitor", monitor)
        connect(builder, adaptor, "robot_state", safety, "robot_state")
        connect(builder, source, port, safety, "command")
        connect(builder, safety, "command", plant, "actuation")
        if config.log_hz:
            add_loggers(builder, 1.0 / config.log_hz)
        if meshcat is not None:
            steps = self.walk_plan.footsteps if self.controller_name == "walk" else ()
            view = Visualizer(
                meshcat,
                self.world,
                self.carry.carried,
                config.meshcat_hz,
                [(s.x, s.y, s.yaw, s.foot) for s in steps] or None,
            )
            _add(builder, "visualizer", view)
            for name in ("robot_state", "percept", "guidance", "contact_force"):
                source, port = getattr(sensed, name)
                connect(builder, source, port, view, name)


def make_station(
    config: StationConfig | None = None, *, plant: str = "mujoco", controller: str = "policy", meshcat: Any = None
) -> Station:
    """One Diagram that carries.

    Args:
        config: numbers of the station.
        plant: mujoco, or drake (a MultibodyPlant of the same robot, object and scene).
        controller: policy; hold (stands with the object); walk, pickup (`hotice.control`); pickup_then_policy.
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


def _physics_step(station: Station) -> float:
    config, task, kind = station.config, station.task, station.controller_name
    trained = station.plant_name == "mujoco" and kind == "policy" and config.servo == "motor"
    default = task.physics_dt_s if trained else CONTROLLED_DT_S if kind in TORQUE_CONTROLLERS else FINE_DT_S
    step = config.physics_dt_s or default
    ratio = task.control_dt_s / step
    if abs(ratio - round(ratio)) > 1e-6 or ratio < 1:
        raise InvalidConfig(f"physics_dt_s is {step!r}: the control period {task.control_dt_s:g} s must be a multiple")
    return step
