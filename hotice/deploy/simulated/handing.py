"""Hands of somebody who gives a simulated robot its object: kept aside, held between its palms, let go."""

from __future__ import annotations

from typing import Literal

import mujoco
import numpy as np

from hotice.deploy.simulated.world import STEP_S, World
from hotice.model import builder, g1
from hotice.model.frames import quat_conj, quat_from_yaw, quat_mul, quat_rotate, yaw_from_quat

ASIDE_M = 3.0
"""Height at which the object waits, where nothing is."""
HOLD_N_M, HOLD_NS_M = 2_000.0, 60.0
TURN_NM, TURN_NMS = 20.0, 0.5
"""Stiffness and damping of the hands (ours)."""
FADE_S = 0.3

Stage = Literal["aside", "held", "let go", "gone"]


class Handing:
    """One object on its way to the robot; `stage` says where."""

    def __init__(self, world: World, stage: Stage) -> None:
        self._world, self.stage = world, stage
        self._body = world.model.body(builder.OBJECT_BODY).id
        self._share = 1.0
        carry = world.carry
        self._p_PO_level, self._quat_O = carry.object_pos_W - carry.root_pos_W, carry.quat_WO
        x, y, _ = world.scene.start
        self._aside = np.array([x, y, ASIDE_M, 1.0, 0.0, 0.0, 0.0])
        self.act()

    def go_on(self) -> None:
        """The next stage: aside → held where the carry state has it → let go."""
        if self.stage == "aside":
            self._world.object_pose[:], self._world.object_velocity[:] = self._place(), 0.0
            self.stage = "held"
        elif self.stage == "held":
            self.stage = "let go"

    def act(self) -> None:
        """Keeps the object where it is, or lays the hands' force on it, for the next physics step."""
        if self.stage == "aside":
            self._world.object_pose[:], self._world.object_velocity[:] = self._aside, 0.0
        elif self.stage != "gone":
            self._hold()

    def _place(self) -> np.ndarray:
        """Where the carry state has the object, beside the pelvis as it stands now, upright, (7,)."""
        qpos = self._world.data.qpos
        turn = quat_from_yaw(yaw_from_quat(qpos[g1.ROOT_QUAT]))
        return np.concatenate([qpos[g1.ROOT_POS] + quat_rotate(turn, self._p_PO_level), quat_mul(turn, self._quat_O)])

    def _hold(self) -> None:
        force = self._world.data.xfrc_applied[self._body]
        if self.stage == "let go":
            self._share = max(0.0, self._share - STEP_S / FADE_S)
            if not self._share:
                self.stage = "gone"
        wished, pose, velocity, turn = self._place(), self._world.object_pose, self._world.object_velocity, np.zeros(3)
        mujoco.mju_quat2Vel(turn, quat_mul(wished[3:], quat_conj(pose[3:])), 1.0)
        weight = self._world.carry.carried.mass_kg * -self._world.model.opt.gravity
        rate_W = quat_rotate(pose[3:], velocity[3:])
        force[:3] = self._share * (HOLD_N_M * (wished[:3] - pose[:3]) - HOLD_NS_M * velocity[:3] + weight)
        force[3:] = self._share * (TURN_NM * turn - TURN_NMS * rate_W)
