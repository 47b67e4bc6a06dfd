"""World of a simulated robot: the G1 with all its joints, object and scene in MuJoCo, as evaluations build them."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from hotice.deploy.simulated.motors import JOINTS, MotorCommand, Motors
from hotice.errors import SimulationError
from hotice.model import builder, g1
from hotice.model.carry import CarryState, holding_torques
from hotice.model.dynamics import DynamicsConfig, perturb
from hotice.model.moving.mocap import Movers
from hotice.model.robot_state import RobotState
from hotice.model.scene import Scene
from hotice.task.judge import Judge
from hotice.task.protocols import Protocol
from hotice.task.rules import MOVES_M_S, STANDS_S, walked_into

Array = NDArray[np.float64]
STEP_S = 0.002
"""Physics step, and the period of states and commands: 500 Hz."""
JOINT_POS, JOINT_VEL = slice(7, 7 + JOINTS), slice(6, 6 + JOINTS)


class World:
    """One robot with an object in a scene, in elliptic cones at 2 ms; `motors` are what it is commanded by.

    Attributes:
        model, data: MuJoCo's; data stands at the present configuration, its kinematics too.
        movers: what moves in the scene, waiting for `Movers.begin`.
        carry: the carry state that the object is held in, at the scene's origin.
        start: the robot and its object in the carry state, standing at the scene's start.
    """

    def __init__(
        self,
        carry: CarryState,
        scene: Scene,
        protocol: Protocol,
        dynamics: DynamicsConfig,
        seed: int,
        change: Callable[[mujoco.MjModel], mujoco.MjModel] | None = None,
    ) -> None:
        """Compiles it; `dynamics` draws the robot's parameters with `seed`, or `change` makes them instead."""
        model = builder.build_model(carry.carried, scene, joints=29, timestep_s=STEP_S, elliptic=protocol.elliptic)
        # a diverged state must stay visible
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
        if change is not None:
            model = change(model)
        elif not dynamics.nominal:
            model = perturb(model, dynamics, np.random.default_rng([seed, 1]))
        self.model, self.data = model, mujoco.MjData(model)
        self.carry, self.scene = carry, scene
        self.movers = Movers(self.data, scene, STEP_S)
        self._places: deque[Array] = deque(maxlen=1 + round(STANDS_S / STEP_S))
        self.motors = Motors(model)
        self.start = RobotState.at_start(carry, scene.start)
        self._judge = Judge(model)
        self._object_pos = int(model.joint("object_free").qposadr[0])
        self._object_vel = int(model.joint("object_free").dofadr[0])
        self._pelvis, self._torso = model.body(g1.ROOT_BODY).id, model.body(g1.TORSO_BODY).id
        self.touched = ""
        """The first collision with an obstacle, by its name in `hotice.task.rules`; empty for none."""
        self.place(self.start)

    def place(self, state: RobotState) -> None:
        """Puts robot and object into a configuration."""
        self.data.qpos[:], self.data.qvel[:] = state.to_mujoco(joints=29)
        mujoco.mj_forward(self.model, self.data)

    def step(self) -> None:
        """One physics step of the motors' command and the forces laid on. Raises `SimulationError`."""
        self.movers.step()
        self.motors.actuate(self.data)
        mujoco.mj_step(self.model, self.data)
        self._places.append(self.data.qpos[:2].copy())
        self.touched = self.touched or self._touch()
        if not np.isfinite(self.data.qpos.dot(self.data.qpos) + self.data.qvel.dot(self.data.qvel)):
            raise SimulationError(f"physics diverged at {self.data.time:.3f} s: the state is not finite")
        mujoco.mj_kinematics(self.model, self.data)

    def _touch(self) -> str:
        """A collision with an obstacle now, by its name in `hotice.task.rules`; empty for none."""
        outcome = self._judge.collision(self.data)
        if not outcome or not self.scene.moving:
            return outcome
        met = bool(self._judge.met(self.data) & self.movers.fast(MOVES_M_S))
        way_m = float(np.linalg.norm(self._places[-1] - self._places[0]))
        return "walked_into" if walked_into(met, way_m) else outcome

    def push(self, velocity_W: ArrayLike) -> None:
        """Changes the pelvis' horizontal velocity at once by (2,) [m/s], as the pushes of evaluations do."""
        self.data.qvel[:2] += velocity_W

    def holding(self) -> MotorCommand:
        """What holds the carry state: its angles, the trained gains and the static torques of all joints."""
        kp, kd = g1.gains(g1.ALL_JOINTS)
        zero = np.zeros(JOINTS)
        return MotorCommand(self.start.joint_pos, zero, holding_torques(self.carry), kp, kd, np.ones(JOINTS, bool))

    @property
    def failure(self) -> str:
        """A fall or drop, by its name in `hotice.task.rules`; empty for none."""
        return self._judge.failure(self.data)

    @property
    def joint_pos(self) -> Array:
        """Positions of the joints, (29,) [rad]."""
        return self.data.qpos[JOINT_POS]

    @property
    def joint_vel(self) -> Array:
        """Speeds of the joints, (29,) [rad/s]."""
        return self.data.qvel[JOINT_VEL]

    @property
    def object_pose(self) -> Array:
        """(7,) position [m] and quaternion wxyz of the object, a view."""
        return self.data.qpos[self._object_pos : self._object_pos + 7]

    @property
    def object_velocity(self) -> Array:
        """(6,) linear in W and angular in the object's frame, a view."""
        return self.data.qvel[self._object_vel : self._object_vel + 6]

    @property
    def lowest_sole_m(self) -> float:
        """Height of the lowest point of both soles [m]."""
        soles = [self.model.geom(f"{side}_sole_{i}").id for side in g1.SIDES for i in range(4)]
        return float((self.data.geom_xpos[soles, 2] - self.model.geom_size[soles, 0]).min())
