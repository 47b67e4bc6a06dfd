"""Terms of the robot's dynamics at one state: mass matrix, bias forces, Jacobians of the frames that have tasks.

Pinocchio computes, into views that are taken once; a compiled function turns them into frame Jacobians in place. v and
a are Pinocchio's: twist of the pelvis in its own frame (linear, angular), then the 20 joints of `g1.ACTION_JOINTS`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hotice import checks
from hotice.compiled import compiled
from hotice.control.controller import Measurement
from hotice.errors import InvalidConfig, MissingExtra
from hotice.model import builder, g1

if TYPE_CHECKING:
    import pinocchio

Array = NDArray[np.float64]
NQ, NV = 27, 26
FRAMES = ("pelvis", "left_foot", "right_foot", "left_hand", "right_hand")
"""Frames that have tasks. The waist is welded, so the pelvis carries the torso; a foot is its ankle-roll link, soles
3.5 cm below; a hand is the middle of its palm (site `left_hand`)."""
PELVIS, LEFT_FOOT, RIGHT_FOOT, LEFT_HAND, RIGHT_HAND = range(len(FRAMES))
FEET, HANDS = slice(LEFT_FOOT, RIGHT_FOOT + 1), slice(LEFT_HAND, RIGHT_HAND + 1)
_SOURCE = ("pelvis_site", "left_ankle_roll_link", "right_ankle_roll_link", "left_hand", "right_hand")


def robot_model(wrist_pos: ArrayLike | None = None) -> pinocchio.Model:
    """Robot with free base and 20 joints; waist locked at zero, wrists at `wrist_pos` (6,) [rad], default zero.

    Raises `MissingExtra` without Pinocchio.
    """
    pin = _pinocchio()
    angles = np.zeros(len(g1.WRIST_JOINTS)) if wrist_pos is None else wrist_pos
    wrist = checks.array("wrist_pos (in the order of g1.WRIST_JOINTS)", angles, len(g1.WRIST_JOINTS))
    model = builder.pinocchio_model(29)
    for frame in model.frames:  # a body and a site may share a name in MJCF, frames of a reduced model may not
        if frame.type == pin.FrameType.OP_FRAME and frame.name == g1.ROOT_BODY:
            frame.name += "_site"
    q = pin.neutral(model)
    for name, angle in zip(g1.WRIST_JOINTS, wrist, strict=True):
        q[model.joints[model.getJointId(name)].idx_q] = angle
    return pin.buildReducedModel(model, [model.getJointId(name) for name in g1.LOCKED_JOINTS], q)


def _pinocchio() -> Any:
    try:
        import pinocchio
    except ModuleNotFoundError:
        raise MissingExtra("whole-body control", "Pinocchio", "drake") from None
    return pinocchio


class Terms:
    """Dynamics and kinematics of the robot at the state of the last `update`.

    Attributes:
        q: (27,), v: (26,) as Pinocchio orders them. M: (26, 26), upper triangle only; h: (26,) bias forces.
        com: (3,) [m], v_com: (3,), com_drift: (3,) acceleration of the centre of mass at a = 0; J_com: (3, 26).
        R_WF: (5, 3, 3), p_WF: (5, 3) poses of `FRAMES`; J_WF: (5, 6, 26), v_WF: (5, 6), drift_WF: (5, 6): linear then
            angular, in W, of the frame's origin: velocity J v, acceleration J a + drift.
        lower, upper: (20,) joint limits [rad]; mass_kg: of the robot.
    """

    def __init__(self, wrist_pos: ArrayLike | None = None) -> None:
        self._pin = pin = _pinocchio()
        self.model = model = robot_model(wrist_pos)
        if tuple(model.names)[2:] != g1.ACTION_JOINTS:
            raise InvalidConfig(
                f"joints of the Pinocchio model are {list(model.names)[2:]}: g1.ACTION_JOINTS are needed"
            )
        self.data = data = model.createData()
        self.q, self.v, self._zero = pin.neutral(model), np.zeros(NV), np.zeros(NV)
        pin.computeAllTerms(model, data, self.q, self.v)
        pin.centerOfMass(model, data, self.q, self.v, self._zero)
        self.M, self.h, self._J, self._dJ, self.J_com = data.M, data.nle, data.J, data.dJ, data.Jcom
        self.com, self.v_com, self.com_drift = data.com[0], data.vcom[0], data.acom[0]
        frames = [model.frames[model.getFrameId(name)] for name in _SOURCE]
        self._joint = [int(f.parentJoint) for f in frames]
        self._pose = [data.oMi[j] for j in self._joint]
        self._R_JF = np.array([f.placement.rotation for f in frames])
        self._p_JF = np.array([f.placement.translation for f in frames])
        self._R_WJ, self._p_WJ = np.zeros((5, 3, 3)), np.zeros((5, 3))
        self._moves = np.zeros((5, NV), dtype=np.bool_)
        for row, joint in zip(self._moves, self._joint, strict=True):
            for above in model.supports[joint].tolist()[1:]:
                start = model.joints[above].idx_v
                row[start : start + model.joints[above].nv] = True
        self.R_WF, self.p_WF = np.zeros((5, 3, 3)), np.zeros((5, 3))
        self.J_WF, self.v_WF, self.drift_WF = np.zeros((5, 6, NV)), np.zeros((5, 6)), np.zeros((5, 6))
        self.lower = model.lowerPositionLimit[g1.JOINT_POS].copy()
        self.upper = model.upperPositionLimit[g1.JOINT_POS].copy()
        self.mass_kg = float(sum(i.mass for i in model.inertias))

    def update(self, measurement: Measurement) -> None:
        """Takes the state of the measurement."""
        quat, q, v = measurement.quat_WP, self.q, self.v
        q[g1.ROOT_POS], q[3:6], q[6], q[g1.JOINT_POS] = measurement.p_WP, quat[1:], quat[0], measurement.joint_pos
        q[g1.ROOT_QUAT] /= np.sqrt(q[g1.ROOT_QUAT] @ q[g1.ROOT_QUAT])
        v[g1.ROOT_RATE], v[g1.JOINT_VEL] = measurement.w_WP_P, measurement.joint_vel
        _into_body(q, measurement.v_WP, v)
        self.refresh()

    def refresh(self) -> None:
        """Computes everything anew from `q` and `v`."""
        pin, model, data = self._pin, self.model, self.data
        pin.computeAllTerms(model, data, self.q, self.v)
        pin.centerOfMass(model, data, self.q, self.v, self._zero)
        for i, pose in enumerate(self._pose):
            self._R_WJ[i], self._p_WJ[i] = pose.rotation, pose.translation
        _frames(
            self._J,
            self._dJ,
            self.v,
            self._moves,
            self._R_WJ,
            self._p_WJ,
            self._R_JF,
            self._p_JF,
            self.R_WF,
            self.p_WF,
            self.J_WF,
            self.v_WF,
            self.drift_WF,
        )


@compiled
def _into_body(q, v_W, v):
    """Linear velocity in W into v[:3], in the pelvis frame."""
    x, y, z, w = -q[3], -q[4], -q[5], q[6]
    tx, ty, tz = 2 * (y * v_W[2] - z * v_W[1]), 2 * (z * v_W[0] - x * v_W[2]), 2 * (x * v_W[1] - y * v_W[0])
    v[0] = v_W[0] + w * tx + y * tz - z * ty
    v[1] = v_W[1] + w * ty + z * tx - x * tz
    v[2] = v_W[2] + w * tz + x * ty - y * tx


@compiled
def _frames(J, dJ, v, moves, R_WJ, p_WJ, R_JF, p_JF, R_WF, p_WF, J_WF, v_WF, drift_WF):
    """Frame poses, Jacobians, velocities and drifts from Jacobians of twists at the origin of W."""
    for f in range(len(p_WF)):
        for r in range(3):
            p_WF[f, r] = p_WJ[f, r]
            for c in range(3):
                p_WF[f, r] += R_WJ[f, r, c] * p_JF[f, c]
                R_WF[f, r, c] = 0.0
                for k in range(3):
                    R_WF[f, r, c] += R_WJ[f, r, k] * R_JF[f, k, c]
        x, y, z = p_WF[f]
        v_WF[f] = 0.0
        drift_WF[f] = 0.0
        for k in range(len(v)):
            if not moves[f, k]:
                continue
            wx, wy, wz = J[3, k], J[4, k], J[5, k]
            J_WF[f, 0, k] = J[0, k] + wy * z - wz * y
            J_WF[f, 1, k] = J[1, k] + wz * x - wx * z
            J_WF[f, 2, k] = J[2, k] + wx * y - wy * x
            J_WF[f, 3, k], J_WF[f, 4, k], J_WF[f, 5, k] = wx, wy, wz
            ax, ay, az = dJ[3, k], dJ[4, k], dJ[5, k]
            drift_WF[f, 0] += (dJ[0, k] + ay * z - az * y) * v[k]
            drift_WF[f, 1] += (dJ[1, k] + az * x - ax * z) * v[k]
            drift_WF[f, 2] += (dJ[2, k] + ax * y - ay * x) * v[k]
            drift_WF[f, 3] += ax * v[k]
            drift_WF[f, 4] += ay * v[k]
            drift_WF[f, 5] += az * v[k]
            for r in range(6):
                v_WF[f, r] += J_WF[f, r, k] * v[k]
        ux, uy, uz, wx, wy, wz = v_WF[f]
        drift_WF[f, 0] += wy * uz - wz * uy
        drift_WF[f, 1] += wz * ux - wx * uz
        drift_WF[f, 2] += wx * uy - wy * ux
