"""Hands of somebody who gives a simulated robot its object: palms parted, object held between them, let go."""

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
"""Stiffness and damping of the hands that hold the object (ours)."""
PULL_N_M, PULL_NS_M, PULL_N = 10_000.0, 200.0, 150.0
"""Stiffness, damping and greatest force with which each of the robot's hands is pulled outwards (ours)."""
ROOM_M = 0.015
"""So far beside the object are palms that have been pulled apart."""
FADE_S = 0.3
PALM_RADIUS_M = 0.02

Stage = Literal["aside", "parting", "held", "let go", "gone"]


class Handing:
    """One object on its way to the robot; `stage` says where."""

    def __init__(self, world: World, stage: Stage) -> None:
        self._world = world
        self.stage: Stage = stage
        model = world.model
        self._body = model.body(builder.OBJECT_BODY).id
        self._hands = [model.body(f"{side}_wrist_yaw_link").id for side in g1.SIDES]
        self._sites = [model.site(f"{side}_hand").id for side in g1.SIDES]
        self._held_share, self._pull_share = 1.0, 0.0
        carry = world.carry
        self._p_PO_level, self._quat_O = carry.object_pos_W - carry.root_pos_W, carry.quat_WO
        self._half_width_m = float(carry.carried.half_extents_m[1])
        x, y, _ = world.scene.start
        self._aside = np.array([x, y, ASIDE_M, 1.0, 0.0, 0.0, 0.0])
        self.act()

    def go_on(self) -> None:
        """The next key: from aside between the parted palms, where the carry state has it; then let go."""
        if self.stage == "aside":
            self.stage, self._pull_share = "parting", 1.0
        elif self.stage == "held":
            self.stage = "let go"

    def act(self) -> None:
        """Keeps the object where it is, or lays the hands' force on it, for the next physics step."""
        if self.stage in ("aside", "parting"):
            self._world.object_pose[:], self._world.object_velocity[:] = self._aside, 0.0
        if self.stage == "parting" and self._parted():
            self._world.object_pose[:], self._world.object_velocity[:] = self._place(), 0.0
            self.stage = "held"
        if self._pull_share:
            self._pull()
        if self.stage in ("held", "let go"):
            self._hold()

    def _heading(self) -> np.ndarray:
        return quat_from_yaw(yaw_from_quat(self._world.data.qpos[g1.ROOT_QUAT]))

    def _place(self) -> np.ndarray:
        """Where the carry state has the object, beside the pelvis as it stands now, upright, (7,)."""
        turn = self._heading()
        place = self._world.data.qpos[g1.ROOT_POS] + quat_rotate(turn, self._p_PO_level)
        return np.concatenate([place, quat_mul(turn, self._quat_O)])

    def _outwards(self) -> np.ndarray:
        """How far each palm is to its side of the object's place, (2,) [m]."""
        left = quat_rotate(self._heading(), np.array([0.0, 1.0, 0.0]))
        return (self._world.data.site_xpos[self._sites] - self._place()[:3]) @ left * [1.0, -1.0]

    def _parted(self) -> bool:
        return bool((self._outwards() > self._half_width_m + PALM_RADIUS_M).all())

    def _pull(self) -> None:
        """Pulls the hands apart; once the object is there, less and less."""
        data, model = self._world.data, self._world.model
        if self.stage != "parting":
            self._pull_share = max(0.0, self._pull_share - STEP_S / FADE_S)
        left = quat_rotate(self._heading(), np.array([0.0, 1.0, 0.0]))
        wished = self._half_width_m + PALM_RADIUS_M + ROOM_M
        for body, side, now in zip(self._hands, (1.0, -1.0), self._outwards(), strict=True):
            velocity = np.zeros(6)
            mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_BODY, body, velocity, 0)
            force = PULL_N_M * max(0.0, wished - now) - PULL_NS_M * side * float(velocity[3:] @ left)
            force = self._pull_share * float(np.clip(force, -PULL_N, PULL_N))
            data.xfrc_applied[body, :3] = force * side * left

    def _hold(self) -> None:
        force = self._world.data.xfrc_applied[self._body]
        if self.stage == "let go":
            self._held_share = max(0.0, self._held_share - STEP_S / FADE_S)
            if not self._held_share:
                self.stage = "gone"
        wished, pose, velocity, turn = self._place(), self._world.object_pose, self._world.object_velocity, np.zeros(3)
        mujoco.mju_quat2Vel(turn, quat_mul(wished[3:], quat_conj(pose[3:])), 1.0)
        weight = self._world.carry.carried.mass_kg * -self._world.model.opt.gravity
        rate_W = quat_rotate(pose[3:], velocity[3:])
        force[:3] = self._held_share * (HOLD_N_M * (wished[:3] - pose[:3]) - HOLD_NS_M * velocity[:3] + weight)
        force[3:] = self._held_share * (TURN_NM * turn - TURN_NMS * rate_W)
