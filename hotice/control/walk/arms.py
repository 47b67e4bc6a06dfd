"""Arm angles that hold the load level while the trunk leans.

Palms stick to the object, so both move as one chain: four joints of each arm, and the object's height, distance and
pitch. With the wrists locked one degree of freedom is left, and it turns the object about the hands' axis: the forearms
stay level while the trunk leans, and the load rises clear of the thighs.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import mujoco
import numpy as np
from numpy.typing import NDArray

from hotice.errors import CarryInfeasible
from hotice.model import builder, g1
from hotice.model.carry import CarryState
from hotice.model.frames import quat_to_mat, rotation_y

Array = NDArray[np.float64]
STIFFNESS, LEVEL, PLACE = 400.0, 3.0, 0.3
MISS_M = 0.001
LEANS_RAD = np.linspace(0.0, 0.6, 7)
_LEFT_QPOS = slice(12, 16)


@dataclass(frozen=True, eq=False)
class ArmTable:
    """Arm angles that keep the load level.

    Attributes:
        lean_rad: (L,) ascending. joint_pos: (L, 8) order `g1.ARM_JOINTS` [rad].
        p_PO: (L, 3) object's centre in the pelvis frame [m]. pitch_rad: (L,) of the object against the trunk.
    """

    lean_rad: Array
    joint_pos: Array
    p_PO: Array
    pitch_rad: Array

    def at(self, lean_rad: float) -> Array:
        """Arm angles (8,) at a lean; the ends of the table beyond it."""
        return np.array([np.interp(lean_rad, self.lean_rad, column) for column in self.joint_pos.T])

    def object_at(self, lean_rad: float) -> tuple[Array, float]:
        """Object's centre (3,) [m] in the pelvis frame, and its pitch against the trunk [rad]."""
        place = np.array([np.interp(lean_rad, self.lean_rad, column) for column in self.p_PO.T])
        return place, float(np.interp(lean_rad, self.lean_rad, self.pitch_rad))


@lru_cache(maxsize=4)
def _trunk(wrist_pos: tuple[float, ...]) -> mujoco.MjModel:
    return builder.build_model(None, wrist_pos=np.array(wrist_pos), floor=False, fixed_base=True)


def level_arms(state: CarryState) -> ArmTable:
    """Arm angles by lean, from a carry state's grasp. Raises `CarryInfeasible` if the palms would leave the object."""
    from scipy.optimize import least_squares

    model = _trunk(tuple(np.round(state.wrist_pos, 9)))
    data = mujoco.MjData(model)
    pelvis = model.body(g1.ROOT_BODY).pos.copy()
    palm_ids = [model.geom(f"left_palm_{i}").id for i in range(4)]
    R_WP = quat_to_mat(state.quat_WP)
    p_PO = R_WP.T @ (state.object_pos_W - state.root_pos_W)
    tilt = -2.0 * float(np.arcsin(state.quat_WP[2]))  # a carried object is upright
    left = state.joint_pos[g1.UPPER][:4]

    def palms(angles: Array) -> Array:
        data.qpos[_LEFT_QPOS] = angles
        mujoco.mj_kinematics(model, data)
        return data.geom_xpos[palm_ids] - pelvis

    p_OH = (palms(left) - p_PO) @ rotation_y(tilt)

    def miss(v: Array) -> Array:
        return palms(v[:4]) - np.array([v[4], 0.0, v[5]]) - p_OH @ rotation_y(v[6]).T

    bounds = model.jnt_range[_LEFT_QPOS]
    low, high = np.append(bounds[:, 0], [-1.0, -1.0, -2.0]), np.append(bounds[:, 1], [1.0, 1.0, 2.0])
    rows, guess = [], np.array([*left, p_PO[0], p_PO[2], tilt])
    for lean in LEANS_RAD:

        def residual(v: Array, lean: float = lean) -> Array:
            level = [LEVEL * (v[6] + lean), PLACE * (v[4] - p_PO[0]), PLACE * (v[5] - p_PO[2])]
            return np.concatenate([STIFFNESS * miss(v).ravel(), level])

        guess = least_squares(residual, guess, bounds=(low, high)).x
        worst = float(np.abs(miss(guess)).max())
        if worst > MISS_M:
            raise CarryInfeasible(
                f"the arms cannot keep this {state.carried.shape} level at a lean of {lean:.2f} rad: the palms would "
                f"miss its sides by {1e3 * worst:.1f} mm"
            )
        rows.append(guess)
    found = np.array(rows)
    sign = g1.mirror_joints()[1][g1.UPPER][4:]
    both = np.concatenate([found[:, :4], sign * found[:, :4]], axis=1)
    place = np.column_stack([found[:, 4], np.zeros(len(found)), found[:, 5]])
    return ArmTable(LEANS_RAD, both, place, found[:, 6])
