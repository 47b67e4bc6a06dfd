"""Tasks of the robot as accelerations: of the centre of mass, of five frames, of the joints.

Each row of a task wants a_ref + kp (x_ref − x) + kd (v_ref − v) and has a weight; weight 0 switches it off. Rows of a
frame are three of its position and three of its orientation, in W or in axes of the caller's choice.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hotice.compiled import compiled
from hotice.control.whole_body.terms import FRAMES, NV
from hotice.errors import UnknownName
from hotice.model import g1

Array = NDArray[np.float64]
ROWS = 3 + 6 * len(FRAMES) + 20


def _zeros(*shape: int) -> Any:
    return field(default_factory=lambda: np.zeros(shape))


def _identity(n: int) -> Any:
    return field(default_factory=lambda: np.tile(np.eye(3), (n, 1, 1)))


@dataclass(kw_only=True)
class Targets:
    """References and weights of all tasks; arrays that are written in place. SI units, in W.

    Attributes:
        com_pos, com_vel, com_acc, com_weight, com_kp, com_kd: (3,).
        frame_pos: (5, 3), frame_rot: (5, 3, 3) R_WF; frame_vel, frame_acc: (5, 6) linear, angular; frame_weight,
            frame_kp, frame_kd: (5, 6); order `FRAMES`. frame_axes: (5, 3, 3) R_WG whose columns are the axes of the
                rows.
        joint_pos, joint_vel, joint_acc, joint_weight, joint_kp, joint_kd: (20,).
    """

    com_pos: Array = _zeros(3)
    com_vel: Array = _zeros(3)
    com_acc: Array = _zeros(3)
    com_weight: Array = _zeros(3)
    com_kp: Array = _zeros(3)
    com_kd: Array = _zeros(3)
    frame_pos: Array = _zeros(5, 3)
    frame_rot: Array = _identity(5)
    frame_vel: Array = _zeros(5, 6)
    frame_acc: Array = _zeros(5, 6)
    frame_weight: Array = _zeros(5, 6)
    frame_kp: Array = _zeros(5, 6)
    frame_kd: Array = _zeros(5, 6)
    frame_axes: Array = _identity(5)
    joint_pos: Array = _zeros(g1.ACTIONS)
    joint_vel: Array = _zeros(g1.ACTIONS)
    joint_acc: Array = _zeros(g1.ACTIONS)
    joint_weight: Array = _zeros(g1.ACTIONS)
    joint_kp: Array = _zeros(g1.ACTIONS)
    joint_kd: Array = _zeros(g1.ACTIONS)

    def gain_com(self, weight: ArrayLike, frequency: float) -> None:
        """Weight () or (3,) and critically damped gains of `frequency` [rad/s] of the centre of mass."""
        self.com_weight[:], self.com_kp[:], self.com_kd[:] = weight, frequency**2, 2.0 * frequency

    def gain_frame(self, name: str, weight: ArrayLike, frequency: float) -> None:
        """Weight () or (6,) and critically damped gains of a frame. Raises `UnknownName`."""
        if name not in FRAMES:
            raise UnknownName("frame", name, FRAMES)
        i = FRAMES.index(name)
        self.frame_weight[i], self.frame_kp[i], self.frame_kd[i] = weight, frequency**2, 2.0 * frequency

    def gain_joints(self, weight: ArrayLike, frequency: float) -> None:
        """Weight () or (20,) and critically damped gains of the joints."""
        self.joint_weight[:], self.joint_kp[:], self.joint_kd[:] = weight, frequency**2, 2.0 * frequency


@compiled
def rotation_error(R_ref, R, out):
    """Rotation vector, in W, that turns R into R_ref, (3,) [rad]."""
    E = R_ref @ R.T
    x, y, z = 0.5 * (E[2, 1] - E[1, 2]), 0.5 * (E[0, 2] - E[2, 0]), 0.5 * (E[1, 0] - E[0, 1])
    sine = math.sqrt(x * x + y * y + z * z)
    angle = math.atan2(sine, 0.5 * (E[0, 0] + E[1, 1] + E[2, 2] - 1.0))
    scale = angle / sine if sine > 1e-9 else 1.0
    out[0], out[1], out[2] = scale * x, scale * y, scale * z


@compiled
def stack_com(J, pos, vel, drift, ref_pos, ref_vel, ref_acc, weight, kp, kd, A, b, w):
    """Rows 0 to 2 of A a = b."""
    for r in range(3):
        A[r] = J[r]
        b[r] = ref_acc[r] + kp[r] * (ref_pos[r] - pos[r]) + kd[r] * (ref_vel[r] - vel[r]) - drift[r]
        w[r] = weight[r]


@compiled
def stack_frames(
    J,
    R,
    pos,
    vel,
    drift,
    ref_pos,
    ref_rot,
    ref_vel,
    ref_acc,
    weight,
    kp,
    kd,
    axes,
    stands,
    stand_weight,
    stand_kd,
    A,
    b,
    w,
):
    """Rows 3 to 32; a foot that stands shall not move, whatever its target says."""
    error, e = np.empty(6), np.empty(3)
    for f in range(len(pos)):
        first = 3 + 6 * f
        if 1 <= f <= 2 and stands[f - 1] > 0.0:
            for r in range(6):
                A[first + r] = J[f, r]
                b[first + r] = -stand_kd * vel[f, r] - drift[f, r]
                w[first + r] = stand_weight
            continue
        rotation_error(ref_rot[f], R[f], e)
        error[:3], error[3:] = ref_pos[f] - pos[f], e
        for half in range(2):
            for r in range(3):
                row, i = first + 3 * half + r, 3 * half + r
                w[row] = weight[f, i]
                b[row] = 0.0
                A[row] = 0.0
                if w[row] == 0.0:
                    continue
                for c in range(3):
                    k, g = 3 * half + c, axes[f, c, r]
                    if g == 0.0:
                        continue
                    A[row] += g * J[f, k]
                    wish = ref_acc[f, k] + kp[f, i] * error[k] + kd[f, i] * (ref_vel[f, k] - vel[f, k])
                    b[row] += g * (wish - drift[f, k])


@compiled
def stack_joints(q, v, ref_pos, ref_vel, ref_acc, weight, kp, kd, A, b, w):
    """The last 20 rows; their Jacobian is constant."""
    for j in range(20):
        row = ROWS - 20 + j
        A[row, NV - 20 + j] = 1.0
        b[row] = ref_acc[j] + kp[j] * (ref_pos[j] - q[j]) + kd[j] * (ref_vel[j] - v[j])
        w[row] = weight[j]
