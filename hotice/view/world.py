"""World of the live view: the robot of evaluations with its object, among obstacles that are moved while it walks."""

from __future__ import annotations

import math
from collections.abc import Iterable

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from hotice.model.builder import OBSTACLE_PREFIX, build_model
from hotice.model.carry import CarryState
from hotice.model.dynamics import perturb
from hotice.model.robot_state import RobotState, joint_index
from hotice.model.scene import Obstacle, Scene
from hotice.replay.touch import obstacle_name, solid_name
from hotice.task.judge import Judge
from hotice.task.protocols import get_protocol
from hotice.task.rules import MOVES_M_S

Array = NDArray[np.float64]
_JOINTS = joint_index(20)


class World:
    """Physics of the protocol `robot`, without its perturbations, at a scene's start; obstacles are mocap bodies.

    Attributes:
        model, data: MuJoCo's; data stands at the present configuration, its kinematics too.
        substeps: physics steps of a control step.
        touched: pairs of a solid of robot or object and an obstacle, by name, that touched in the last control step.
        moved: names of obstacles that moved in it (`hotice.task.rules`).
    """

    def __init__(self, carry: CarryState, scene: Scene, control_dt_s: float) -> None:
        protocol = get_protocol("robot")
        self.carry = carry
        self.substeps = math.ceil(control_dt_s / protocol.physics_dt_s - 1e-9)
        model = build_model(
            carry.carried,
            scene,
            wrist_pos=carry.wrist_pos,
            timestep_s=control_dt_s / self.substeps,
            elliptic=protocol.elliptic,
            movable=True,
        )
        # a diverged state must stay visible
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
        # the middle of the range has no spread: whatever draws it
        self.model = perturb(model, protocol.nominal, np.random.default_rng(0))
        self.data = mujoco.MjData(self.model)
        self._judge = Judge(self.model)
        self._is_obstacle = np.array([self.model.geom(g).name.startswith(OBSTACLE_PREFIX) for g in range(model.ngeom)])
        self._mocap = {o.name: int(model.body(OBSTACLE_PREFIX + o.name).mocapid[0]) for o in scene.obstacles}
        # the waist stands straight, the wrists as they are welded
        self._qpos, self._qvel = (part.copy() for part in RobotState.from_carry(carry).to_mujoco(29))
        self.touched: set[tuple[str, str]] = set()
        self.moved: set[str] = set()
        self._dt_s = control_dt_s
        self.data.qpos[:], self.data.qvel[:] = RobotState.at_start(carry, scene.start).to_mujoco()
        self.data.ctrl[:] = carry.joint_target
        mujoco.mj_forward(self.model, self.data)

    def put(self, obstacles: Iterable[Obstacle]) -> None:
        """Puts obstacles where they are now; whoever stands there is pushed aside by the next steps."""
        for obstacle in obstacles:
            at = self._mocap[obstacle.name]
            self.data.mocap_pos[at], self.data.mocap_quat[at] = obstacle.position_m, obstacle.quaternion_wxyz

    def push(self, velocity_W: ArrayLike) -> None:
        """Changes the pelvis' horizontal velocity at once by (2,) [m/s], as the pushes of evaluations do."""
        self.data.qvel[:2] += velocity_W

    def step(self, target: Array, delay: int = 0, coming: Iterable[Obstacle] = ()) -> None:
        """One control step with joint targets (20,) [rad], which reach the motors `delay` physics steps late.

        `coming`: obstacles that are elsewhere at its end; they go there evenly.
        """
        self.touched = set()
        ways = [_Way(self.data, self._mocap[obstacle.name], obstacle) for obstacle in coming]
        self.moved = {way.name for way in ways if way.length > MOVES_M_S * self._dt_s}
        for step in range(self.substeps):
            if step == min(delay, self.substeps - 1):
                self.data.ctrl[:] = target
            for way in ways:
                way.go(self.data, (step + 1) / self.substeps)
            mujoco.mj_step(self.model, self.data)
            self._see_touches()
        mujoco.mj_kinematics(self.model, self.data)

    def _see_touches(self) -> None:
        contact = self.data.contact
        geoms = contact.geom
        hits = self._is_obstacle[geoms].any(axis=1) & (contact.dist < 0.0)
        for pair in geoms[hits]:
            solid, obstacle = sorted(pair.tolist(), key=self._is_obstacle.__getitem__)
            self.touched.add((solid_name(self.model, solid), obstacle_name(self.model, obstacle)))

    @property
    def failure(self) -> str:
        """A fall, a drop or a diverged state, by its name in `hotice.task.rules`; empty for none."""
        return self._judge.failure(self.data)

    def state(self) -> tuple[Array, Array]:
        """Qpos (43,) and qvel (41,) of the robot with all 29 joints and its object."""
        qpos, qvel, now = self._qpos, self._qvel, self.data
        qpos[:7], qvel[:6] = now.qpos[:7], now.qvel[:6]
        qpos[7 + _JOINTS], qvel[6 + _JOINTS] = now.qpos[7:27], now.qvel[6:26]
        qpos[36:], qvel[35:] = now.qpos[27:], now.qvel[26:]
        return qpos, qvel


class _Way:
    """From where a mocap body is to where its obstacle is to be; `length`: of the place [m] or turn [rad]."""

    def __init__(self, data: mujoco.MjData, at: int, obstacle: Obstacle) -> None:
        self.name, self._at = obstacle.name, at
        self._from, self._to = data.mocap_pos[at].copy(), np.array(obstacle.position_m)
        self._quat, quat = data.mocap_quat[at].copy(), np.array(obstacle.quaternion_wxyz)
        # a quaternion and its negative are one orientation: the short way
        self._quat_to = quat if quat @ self._quat >= 0.0 else -quat
        turn = 2.0 * math.acos(min(1.0, float(self._quat_to @ self._quat)))
        self.length = max(float(np.linalg.norm(self._to - self._from)), turn)

    def go(self, data: mujoco.MjData, share: float) -> None:
        data.mocap_pos[self._at] = self._from + share * (self._to - self._from)
        # MuJoCo makes it a unit one
        data.mocap_quat[self._at] = self._quat + share * (self._quat_to - self._quat)
