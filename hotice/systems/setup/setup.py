"""Everything that is decided about a station before its diagram is built; whoever builds or rehearses asks here."""

from __future__ import annotations

import copy
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import mujoco
import numpy as np
from numpy.typing import NDArray

from hotice.errors import InvalidConfig, UnknownName
from hotice.fields import HodPf, build_hod_pf
from hotice.model import Scene, load_scene
from hotice.model.carry import CarryState, Posture, solve_carry
from hotice.model.motors import to_motors
from hotice.model.moving.still import only_still
from hotice.policy import PolicySession, PolicyTask, open_policy
from hotice.systems.joint_pd import JointServo
from hotice.systems.setup.config import StationConfig
from hotice.systems.setup.robot import drawn_robot, standing_qpos
from hotice.systems.setup.table import around_table, pick_origin, table_of, with_table

if TYPE_CHECKING:
    from hotice.control.walk.plan import WalkPlan
    from hotice.systems.setup.pick import PickSetting
    from hotice.systems.setup.put import PutSetting

PLANTS = ("mujoco", "drake")
CONTROLLERS = ("policy", "hold", "walk", "pickup", "pickup_then_policy", "job")
"""hold: the carry state's joint targets, without a policy: standing with the object. job: pickup_then_policy,
and at the goal the object is put down."""
TORQUE_CONTROLLERS = ("walk", "pickup", "pickup_then_policy", "job")
PICKING = ("pickup", "pickup_then_policy", "job")
HANDING_OVER = ("pickup_then_policy", "job")
FOR_MOVING = ("policy", "hold")
"""Controllers that know scenes in which something moves."""
FINE_DT_S, CONTROLLED_DT_S = 0.002, 0.005
"""Physics step but where policies or controllers meet the plant that they were made with, and of the latter [s]."""
Array = NDArray[np.floating]


@dataclass(frozen=True, kw_only=True, eq=False)
class StationSetup:
    """Parts of a station, decided before its diagram; see `decide`.

    Attributes:
        config, plant_name, controller_name: as given.
        motors: the plant's joints have motors that take torques, else position servos. torques: commands to the plant
            are torques, not joint targets.
        scene: of the config; world: the same and, for a pick-up, the table; pf: its fields, which lead around the
            table.
        policy, task: the policy file and its constants. physics_dt_s: step of the plant [s].
        carry: carry state that the policy and `hold` keep, and where they start; of a pick-up, where it ends.
        pick: the pick-up's setting, or None; put: the put-down's of a job, or None.
    """

    config: StationConfig
    plant_name: str
    controller_name: str
    motors: bool
    torques: bool
    scene: Scene
    world: Scene
    policy: PolicySession
    task: PolicyTask
    physics_dt_s: float
    carry: CarryState
    pf: HodPf
    pick: PickSetting | None = None
    put: PutSetting | None = None

    @classmethod
    def decide(cls, config: StationConfig, plant: str = "mujoco", controller: str = "policy") -> StationSetup:
        """Reads, solves and plans what the station needs; arguments and errors are those of `make_station`."""
        if not isinstance(config, StationConfig):
            raise InvalidConfig(
                f"config is {config!r}: a StationConfig is needed; read one with StationConfig.load(path)"
            )
        if plant not in PLANTS:
            raise UnknownName("plant", plant, PLANTS)
        if controller not in CONTROLLERS:
            raise UnknownName("controller", controller, CONTROLLERS)
        motors = controller in TORQUE_CONTROLLERS or config.servo == "pd"
        scene = world = config.scene if isinstance(config.scene, Scene) else load_scene(config.scene)
        if controller not in FOR_MOVING:
            only_still(scene, f"controller {controller!r} of a station")
        policy = open_policy(config.policy)
        task = PolicyTask.from_meta(policy.meta, policy.name)
        physics_dt_s = _physics_step(config, task, plant, controller)
        carry = solve_carry(config.carried, Posture(pelvis_height_m=config.pelvis_height_m))
        picks = controller in PICKING
        if picks:
            world = with_table(scene, table_of(scene, config))
        if controller == "job":
            from hotice.systems.setup.put import goal_support

            world = with_table(world, goal_support(scene, config))
        pf = build_hod_pf(around_table(world).still(), task.resolution_m, task.margin_m)
        pick = None
        if picks:
            from hotice.systems.setup.departure import plan_departure
            from hotice.systems.setup.pick import plan_pick

            departs = controller in HANDING_OVER
            departure = plan_departure(pf, task, carry, pick_origin(scene, config)) if departs else None
            pick = plan_pick(config, scene, departure)
        put = None
        if pick is not None and controller == "job":
            from hotice.systems.setup.put import plan_put

            put = plan_put(config, scene, pick.controller.planner.above_m)
        return cls(
            config=config,
            plant_name=plant,
            controller_name=controller,
            motors=motors,
            torques=motors and (controller in TORQUE_CONTROLLERS or plant == "drake"),
            scene=scene,
            world=world,
            policy=policy,
            task=task,
            physics_dt_s=physics_dt_s,
            carry=carry if pick is None else pick.carry,
            pf=pf,
            pick=pick,
            put=put,
        )

    @cached_property
    def walk_plan(self) -> WalkPlan:
        """Footsteps and postures to the goal. Raises `UnreachableGoal`."""
        from hotice.control.walk import plan_walk

        return plan_walk(self.pf, self.carry, self.scene.start)

    @cached_property
    def robot(self) -> mujoco.MjModel:
        """Model of robot, object and world with position servos, its parameters drawn from `config.dynamics`."""
        return drawn_robot(self.config, self.world, self.carry, self.physics_dt_s)

    def model(self) -> mujoco.MjModel:
        """Copy of `robot` for the plant: position servos where the motors have them, else motors that take torques."""
        model = copy.copy(self.robot)
        if self.motors:
            to_motors(model, None if self.torques else 1.0)
        return model

    def servo(self) -> JointServo:
        """Gains, limits and encoders, in torques as commanded, of joints that a servo in the diagram drives."""
        return JointServo.of_g1() if self.config.dynamics.nominal else JointServo.commanding(self.robot)

    @property
    def start_qpos(self) -> Array:
        """Where the default Context starts, (34,) in MuJoCo's order."""
        return standing_qpos(self.carry, self.scene.start) if self.pick is None else self.pick.qpos


def _physics_step(config: StationConfig, task: PolicyTask, plant: str, controller: str) -> float:
    trained = plant == "mujoco" and controller == "policy" and config.servo == "motor"
    default = task.physics_dt_s if trained else CONTROLLED_DT_S if controller in TORQUE_CONTROLLERS else FINE_DT_S
    step = config.physics_dt_s or default
    ratio = task.control_dt_s / step
    if abs(ratio - round(ratio)) > 1e-6 or ratio < 1:
        raise InvalidConfig(f"physics_dt_s is {step!r}: the control period {task.control_dt_s:g} s must be a multiple")
    return step
