"""The MuJoCo robot that controllers of this package drive: joint torques in, measurements out.

For benchmarks, tests and notebooks; a Drake diagram has its own plant.
"""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from hotice.control.controller import Measurement
from hotice.model import g1
from hotice.model.motors import to_motors

Array = NDArray[np.float64]


class TorquePlant:
    """A 20-joint model of `build_model`, with or without object, driven by torques.

    `model`, `data`: MuJoCo's. `measure` gives the true state and contact forces; noise is the caller's.
    """

    def __init__(self, model: mujoco.MjModel) -> None:
        to_motors(model)
        self.model, self.data = model, mujoco.MjData(model)
        self.carries = model.nq == 34
        self._foot = [model.body(f"{s}_ankle_roll_link").id for s in g1.SIDES]
        self._hand = [model.body(f"{s}_wrist_yaw_link").id for s in g1.SIDES]

    def reset(self, qpos: ArrayLike, qvel: ArrayLike | None = None) -> None:
        """Starts from a state, at time zero."""
        mujoco.mj_resetData(self.model, self.data)
        self.data.qpos[:] = qpos
        if qvel is not None:
            self.data.qvel[:] = qvel
        mujoco.mj_forward(self.model, self.data)

    def step(self, torque: ArrayLike, steps: int = 1) -> None:
        """Applies torques (20,) for some physics steps."""
        self.data.ctrl[:] = torque
        mujoco.mj_step(self.model, self.data, steps)

    def measure(self) -> Measurement:
        """The true state; contact forces are those of the last physics step."""
        q, v = self.data.qpos.copy(), self.data.qvel.copy()
        held = {}
        if self.carries:
            held = {"p_WO": q[g1.OBJECT_POS], "quat_WO": q[g1.OBJECT_QUAT]}
            held |= {"v_WO": v[g1.OBJECT_VEL], "w_WO_O": v[g1.OBJECT_RATE]}
        foot, hand = self.contact_forces()
        return Measurement(
            time_s=self.data.time,
            joint_pos=q[g1.JOINT_POS],
            joint_vel=v[g1.JOINT_VEL],
            p_WP=q[g1.ROOT_POS],
            quat_WP=q[g1.ROOT_QUAT],
            v_WP=v[g1.ROOT_VEL],
            w_WP_P=v[g1.ROOT_RATE],
            foot_force_W=foot,
            hand_force_W=hand,
            **held,
        )

    def contact_forces(self) -> tuple[Array, Array]:
        """Force on each foot and each hand, (2, 3) and (2, 3) in W [N]."""
        foot, hand = np.zeros((2, 3)), np.zeros((2, 3))
        wrench, model, data = np.zeros(6), self.model, self.data
        for i in range(data.ncon):
            contact = data.contact[i]
            mujoco.mj_contactForce(model, data, i, wrench)
            force = contact.frame.reshape(3, 3).T @ wrench[:3]  # on the second geom
            for sign, geom in ((-1.0, contact.geom1), (1.0, contact.geom2)):
                body = int(model.geom_bodyid[geom])
                if body in self._foot:
                    foot[self._foot.index(body)] += sign * force
                elif body in self._hand:
                    hand[self._hand.index(body)] += sign * force
        return foot, hand
