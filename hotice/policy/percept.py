"""Percept: what the robot knows of itself and the object at one instant, the sensed part of the policy's input.

True, when computed from a state by `PerceptModel`; with noise, after a sensor model. Frames: W world, P pelvis, O
object.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import mujoco
import numpy as np
from numpy.typing import NDArray

from hotice.model import builder, g1
from hotice.model.objects import CarriedObject
from hotice.model.robot_state import joint_index
from hotice.policy.vectors import NamedVector

Array = NDArray[np.float64]
NUM_SGF, NUM_HANDS = len(g1.SGF_KEYPOINTS), len(g1.OGF_KEYPOINTS)
NUM_POINTS = NUM_SGF + NUM_HANDS


class Percept(NamedVector):
    """One instant. Joint order is `g1.ACTION_JOINTS`; keypoints are the nine of the SGF, then the hands.

    Attributes:
        p_WP: (3,) pelvis [m]; yaw: (1,) its heading [rad]; gravity_P: (3,) direction of gravity in P.
        w_WP_P: (3,) gyro [rad/s]; q: (20,) [rad]; qd: (20,) [rad/s].
        p_WK: (11, 3) keypoints of the robot [m].
        p_WO: (3,) object [m]; R_WO: (3, 3); p_WOK: (8, 3) its keypoints in W [m].
    """

    p_WP: Array
    yaw: Array
    gravity_P: Array
    w_WP_P: Array
    q: Array
    qd: Array
    p_WK: Array
    p_WO: Array
    R_WO: Array
    p_WOK: Array

    SHAPES = {
        "p_WP": (3,),
        "yaw": (1,),
        "gravity_P": (3,),
        "w_WP_P": (3,),
        "q": (20,),
        "qd": (20,),
        "p_WK": (NUM_POINTS, 3),
        "p_WO": (3,),
        "R_WO": (3, 3),
        "p_WOK": (8, 3),
    }


class PerceptModel:
    """True percepts of states of the 29-joint robot with an object, by MuJoCo's kinematics."""

    def __init__(self, carried: CarriedObject) -> None:
        self.carried = carried
        self.model = builder.build_model(carried, joints=29, floor=False)
        self._data = mujoco.MjData(self.model)
        self._sites = np.array([self.model.site(name).id for name in g1.SGF_KEYPOINTS + g1.OGF_KEYPOINTS])
        pelvis, carried_body = self.model.body(g1.ROOT_BODY).id, self.model.body(builder.OBJECT_BODY).id
        self._p_OK = carried.keypoints()
        self._q, self._qd = 7 + joint_index(20), 6 + joint_index(20)
        # views of what kinematics write: looking them up costs more than the kinematics do
        data = self._data
        self._qpos, self._p_WS = data.qpos, data.site_xpos
        self._p_WP, self._R_WP = data.xpos[pelvis], data.xmat[pelvis]
        self._p_WO, self._R_WO = data.xpos[carried_body], data.xmat[carried_body].reshape(3, 3)

    def keypoints_at(self, qpos: Array) -> Callable[[Array], Array]:
        """Function from the policy's joints (20,) to keypoints (11, 3) in W [m], all else as in `qpos` (43,)."""

        def keypoints(q: Array) -> Array:
            self._qpos[:] = qpos
            self._qpos[self._q] = q
            mujoco.mj_kinematics(self.model, self._data)
            return self._p_WS.take(self._sites, 0)

        return keypoints

    def __call__(self, qpos: Array, qvel: Array) -> Percept:
        """Percept of `RobotState.to_mujoco(29)`: qpos (43,) and qvel (41,)."""
        self._qpos[:] = qpos
        mujoco.mj_kinematics(self.model, self._data)
        R_WP, R_WO, p_WO = self._R_WP, self._R_WO, self._p_WO
        percept = Percept(np.empty(Percept.SIZE))
        percept.p_WP[:] = self._p_WP
        percept.yaw[0] = math.atan2(R_WP[3], R_WP[0])
        np.negative(R_WP[6:], out=percept.gravity_P)
        percept.w_WP_P[:] = qvel[g1.ROOT_RATE]
        percept.q[:], percept.qd[:] = qpos[self._q], qvel[self._qd]
        percept.p_WK[:] = self._p_WS.take(self._sites, 0)
        percept.p_WO[:], percept.R_WO[:] = p_WO, R_WO
        p_OK = self._p_OK if self.carried.keypoints_world_aligned else self._p_OK.dot(R_WO.T)
        np.add(p_WO, p_OK, out=percept.p_WOK)
        return percept
