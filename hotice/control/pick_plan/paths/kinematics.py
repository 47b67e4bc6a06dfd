"""The robot's kinematics as CasADi expressions, by adam-robotics from the MuJoCo model.

x (26,): pelvis position [m], its roll, pitch, yaw [rad], the 20 joints of `g1.ACTION_JOINTS` [rad]. The wrists are a
parameter, so that one expression serves every object.
"""

from __future__ import annotations

import warnings
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hotice.errors import MissingExtra
from hotice.model import builder, g1

if TYPE_CHECKING:
    import casadi

Array = NDArray[np.float64]
NX = 26
LINKS = tuple(f"{side}_{link}" for link in ("ankle_roll_link", "wrist_yaw_link", "knee_link") for side in g1.SIDES)
OUT = {
    "feet_p": (0, 6),
    "feet_R": (6, 24),
    "hands_p": (24, 30),
    "hands_R": (30, 48),
    "knees_p": (48, 54),
    "com": (54, 57),
}
"""Rows of `kinematics` by name: positions of left and right, rotation matrices column by column, centre of mass of the
robot."""


@lru_cache(maxsize=1)
def kinematics() -> casadi.Function:
    """Function (x, wrists (6,)) -> (57,), see `OUT`; hands are the middle of the palms. Raises `MissingExtra`."""
    try:
        import casadi as cs
        from adam.casadi import KinDynComputations
    except ModuleNotFoundError as error:
        raise MissingExtra("planning a pick-up", str(error.name), "drake") from None
    model = builder.build_model(None, joints=29, floor=False)
    with warnings.catch_warnings():
        # of the inertias' axes, which kinematics leave alone
        warnings.filterwarnings("ignore", "Gimbal lock", UserWarning)
        robot = KinDynComputations.from_mujoco_model(model, joints_name_list=list(g1.ALL_JOINTS))
    x, wrists = cs.SX.sym("x", NX), cs.SX.sym("wrists", 6)
    joints = cs.SX.zeros(len(g1.ALL_JOINTS))
    for names, values in ((g1.ACTION_JOINTS, x[6:]), (g1.WRIST_JOINTS, wrists)):
        for i, name in enumerate(names):
            joints[g1.ALL_JOINTS.index(name)] = values[i]
    X_WP = cs.vertcat(cs.horzcat(rotation(cs, x[3:6]), x[:3]), cs.DM([[0, 0, 0, 1]]))
    poses = [robot.forward_kinematics(link, X_WP, joints) for link in LINKS]
    hand = [np.append(model.site(f"{side}_hand").pos, 1.0) for side in g1.SIDES]
    p = [pose[:3, 3] for pose in poses]
    p[2:4] = [(poses[2 + i] @ hand[i])[:3] for i in range(2)]
    R = [cs.reshape(pose[:3, :3], 9, 1) for pose in poses]
    com = robot.CoM_position_fun()(X_WP, joints)
    out = cs.vertcat(*p[:2], *R[:2], *p[2:4], *R[2:4], *p[4:6], com)
    return cs.Function("kinematics", [x, wrists], [out], ["x", "wrists"], ["out"], {"cse": True})


def rotation(cs, rpy):
    """R_WP of roll, pitch and yaw, about fixed axes x, y, z, as Pinocchio's `rpyToMatrix`."""
    (cr, cp, cy), (sr, sp, sy) = [[f(rpy[i]) for i in range(3)] for f in (cs.cos, cs.sin)]
    return cs.vertcat(
        cs.horzcat(cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr),
        cs.horzcat(sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr),
        cs.horzcat(-sp, cp * sr, cp * cr),
    )


def to_x(pin, q: Array) -> Array:
    """Unknowns x (..., 26) of configurations (..., 27) in Pinocchio's order."""
    q = np.asarray(q)
    rpy = np.array([pin.rpy.matrixToRpy(pin.Quaternion(row[g1.ROOT_QUAT]).matrix()) for row in q.reshape(-1, 27)])
    return np.concatenate([q[..., g1.ROOT_POS], rpy.reshape(*q.shape[:-1], 3), q[..., g1.JOINT_POS]], axis=-1)


def to_q(pin, x: Array) -> Array:
    """Configurations (..., 27) of x (..., 26)."""
    quat = np.array([pin.Quaternion(pin.rpy.rpyToMatrix(*row[3:6])).coeffs() for row in x.reshape(-1, NX)])
    return np.concatenate([x[..., :3], quat.reshape(*x.shape[:-1], 4), x[..., 6:]], axis=-1)
