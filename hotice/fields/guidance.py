"""Guidance of one robot state: every keypoint, how it moves with v, and the field vectors it reads (IV-A).

What the batched environment computes in float32 from the simulator, from Pinocchio instead and in float64: for
analysis, diagrams and the robot. Needs pinocchio.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hotice.fields.command import navigation_command
from hotice.fields.defaults import SPEED_M_S, STOP_GAIN_HZ
from hotice.fields.hod_pf import HodPf
from hotice.model import g1
from hotice.model.frames import quat_to_mat
from hotice.model.kinematics import Kinematics
from hotice.model.robot_state import RobotState

Array = NDArray[np.float64]
NUM_SGF, NUM_HANDS = len(g1.SGF_KEYPOINTS), len(g1.OGF_KEYPOINTS)
_STEERED = [g1.SGF_KEYPOINTS.index(name) for name in g1.STEERED_KEYPOINTS]


@dataclass(frozen=True, kw_only=True, eq=False)
class Guidance:
    """K keypoints of a state: nine of the robot and two hands, then eight of the object where one is carried.

    Attributes:
        names: (K,) keypoints of `hotice.model.g1`, then object_0 .. object_7.
        p_WK: (K, 3) [m]; v_WK: (K, 3) [m/s].
        jacobian: (K, 3, nv) d(v_WK)/dv, with v as in `hotice.model.kinematics` for 29 joints.
        force_W: (K, 3) F, of the Standard Guidance Field at the first nine, else of the Object-Centric one [m/s].
        signed_distance: (K,) to the obstacles of that field [m]; geodesic: (K,) to the goal, finite everywhere [m].
        c_W: (3,) navigation command [m/s].
    """

    names: tuple[str, ...]
    p_WK: Array
    v_WK: Array
    jacobian: Array
    force_W: Array
    signed_distance: Array
    geodesic: Array
    c_W: Array


def query(
    pf: HodPf, state: RobotState, *, speed_m_s: float = SPEED_M_S, stop_gain_hz: float = STOP_GAIN_HZ
) -> Guidance:
    """Keypoints of a state and their field vectors; `speed_m_s`, `stop_gain_hz`: see `navigation_command`."""
    kinematics = Kinematics(state.carried is not None)
    v = kinematics.update(state)
    joint, p_JK = kinematics.sites(g1.SGF_KEYPOINTS + g1.OGF_KEYPOINTS)
    p_WK = kinematics.points(joint, p_JK)
    jacobian = kinematics.point_jacobian(joint, p_WK)
    names = g1.SGF_KEYPOINTS + g1.OGF_KEYPOINTS
    if state.carried is not None:
        turns = not state.carried.keypoints_world_aligned
        p_OK = state.carried.keypoints()
        arm_W = p_OK @ quat_to_mat(state.quat_WO).T if turns else p_OK
        p_WK = np.concatenate([p_WK, state.p_WO + arm_W])
        moved = p_WK[-len(p_OK) :] if turns else np.broadcast_to(state.p_WO, p_OK.shape)
        object_jacobian = kinematics.point_jacobian(np.full(len(p_OK), kinematics.object_joint), moved)
        jacobian = np.concatenate([jacobian, object_jacobian])
        names += tuple(f"object_{i}" for i in range(len(p_OK)))
    robot, carried = p_WK[:NUM_SGF], p_WK[NUM_SGF:]
    force_W = np.concatenate([pf.sgf.sample(robot), pf.ogf.sample(carried)])
    return Guidance(
        names=names,
        p_WK=p_WK,
        v_WK=jacobian @ v,
        jacobian=jacobian,
        force_W=force_W,
        signed_distance=np.concatenate([pf.sgf.signed_distance(robot), pf.ogf.signed_distance(carried)]),
        geodesic=np.concatenate([pf.sgf.extended_geodesic_distance(robot), pf.ogf.extended_geodesic_distance(carried)]),
        c_W=navigation_command(
            force_W[_STEERED], pf.scene.goal_W[:2] - state.p_WP[:2], pf.params.attraction, speed_m_s, stop_gain_hz
        )[0],
    )
