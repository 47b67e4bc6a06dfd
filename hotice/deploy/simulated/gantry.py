"""Gantry of a simulated robot: soft straps at the torso that hold it up, are lowered and go slack."""

from __future__ import annotations

import mujoco
import numpy as np

from hotice.deploy.simulated.world import STEP_S, World
from hotice.model import g1
from hotice.model.frames import quat_conj, quat_mul

LIFT_N_M, LIFT_NS_M = 20_000.0, 1_000.0
"""Stiffness and damping of the straps; upwards only, as straps pull (ours)."""
TURN_NM, TURN_NMS = 300.0, 15.0
"""The same against turning [N m/rad, N m s/rad] (ours)."""
LOWERING_M_S = 0.1
SLACK_M = 0.03
"""So far below the torso the straps are slack."""
LOWEST_M = 0.25
"""The torso is lowered no further than this."""
FADE_S = 0.5


class Gantry:
    """Holds the torso where it is when made, softly, until it is lowered or let go."""

    def __init__(self, world: World) -> None:
        self._world = world
        self._body = world.model.body(g1.TORSO_BODY).id
        self._hook = world.data.xpos[self._body].copy()
        self._quat = world.data.xquat[self._body].copy()
        self._share, self._lowering, self._slack = 1.0, False, False

    @property
    def holds(self) -> bool:
        """Whether any strap still pulls or may pull."""
        return self._share > 0.0

    def lower(self) -> None:
        """Lowers it from now on, until the straps are slack and come off."""
        self._lowering = True

    def let_go(self) -> None:
        """Takes it away at once."""
        self._share = 0.0
        self._world.data.xfrc_applied[self._body] = 0.0

    def act(self) -> None:
        """Lays its force on the torso for the next physics step."""
        if not self.holds:
            return
        data = self._world.data
        torso = data.xpos[self._body]
        if self._lowering and not self._slack:
            self._hook[2] -= LOWERING_M_S * STEP_S
            self._slack = bool(self._hook[2] < torso[2] - SLACK_M or self._hook[2] < LOWEST_M)
        if self._slack:
            self._share = max(0.0, self._share - STEP_S / FADE_S)
        velocity, turn = np.zeros(6), np.zeros(3)
        mujoco.mj_objectVelocity(self._world.model, data, mujoco.mjtObj.mjOBJ_BODY, self._body, velocity, 0)
        force = LIFT_N_M * (self._hook - torso) - LIFT_NS_M * velocity[3:]
        force[2] = max(0.0, force[2])
        mujoco.mju_quat2Vel(turn, quat_mul(self._quat, quat_conj(data.xquat[self._body])), 1.0)
        data.xfrc_applied[self._body, :3] = self._share * force
        data.xfrc_applied[self._body, 3:] = self._share * (TURN_NM * turn - TURN_NMS * velocity[:3])
        if not self.holds:
            self.let_go()
