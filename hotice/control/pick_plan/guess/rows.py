"""Targets of a whole-body configuration as rows of a least-squares problem, for first guesses; no collision.

Each target gives residuals r (K,) and their Jacobian (K, 26) by Pinocchio's v; hard ones weigh most.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hotice.compiled import compiled
from hotice.control.pick_plan.grip import PALM_POINTS_M, PALM_RADIUS_M
from hotice.control.pick_plan.task import ObjectPose
from hotice.control.whole_body.terms import LEFT_HAND, NV, PELVIS, Terms
from hotice.model.carry import surface_distance
from hotice.model.frames import rotation_z
from hotice.model.objects import CarriedObject

Array = NDArray[np.float64]
Rows = tuple[Array, Array]


class Pose:
    """Rows of residuals r(q) and their Jacobians by v at the configuration of `terms`."""

    def __init__(self, terms: Terms) -> None:
        self.terms = terms
        self._joints: dict[str, tuple[int, Array]] = {}

    def point(self, frame: int, p_F: Array) -> tuple[Array, Array]:
        """Points p_F (K, 3) of a frame in W, (K, 3), and their Jacobian (K, 3, 26)."""
        t = self.terms
        r = p_F @ t.R_WF[frame].T
        return t.p_WF[frame] + r, _carried_points(t.J_WF[frame], r)

    def point_of_joint(self, name: str) -> tuple[Array, Array]:
        """Origin of a joint in W, (3,), and its Jacobian (3, 26)."""
        t = self.terms
        joint, moves = self._joint(name)
        p = t.data.oMi[joint].translation.copy()
        return p, _carried_points(t.data.J * moves, p[None])[0]

    def _joint(self, name: str) -> tuple[int, Array]:
        if name not in self._joints:
            model = self.terms.model
            joint, moves = model.getJointId(name), np.zeros(NV)
            for above in model.supports[joint].tolist()[1:]:
                first = model.joints[above].idx_v
                moves[first : first + model.joints[above].nv] = 1.0
            self._joints[name] = joint, moves
        return self._joints[name]

    def frame(self, frame: int, p_W: Array, R_W: Array, weight: tuple[float, float]) -> Rows:
        """Position and orientation of a frame, 6 rows."""
        t = self.terms
        E = t.R_WF[frame] @ R_W.T
        turn = 0.5 * np.array([E[2, 1] - E[1, 2], E[0, 2] - E[2, 0], E[1, 0] - E[0, 1]])
        r = np.concatenate([weight[0] * (t.p_WF[frame] - p_W), weight[1] * turn])
        return r, np.repeat(weight, 3)[:, None] * t.J_WF[frame]

    def palms(self, carried: CarriedObject, pose: ObjectPose, gap_m: ArrayLike, weight: float) -> Rows:
        """Every palm sphere is `gap_m`, () or (4,), off the object's surface, 8 rows."""
        r, J = [], []
        for hand in range(2):
            p, by_v = self.point(LEFT_HAND + hand, PALM_POINTS_M)
            distance, normal = surface_distance(carried, (p - pose.p_WO) @ pose.R_WO)
            r.append(weight * (distance - PALM_RADIUS_M - np.asarray(gap_m)))
            J.append(weight * np.einsum("kc,kcv->kv", normal @ pose.R_WO.T, by_v))
        return np.concatenate(r), np.concatenate(J)

    def hand_places(self, pose: ObjectPose, p_OH: Array, axes: Array, weight: float) -> Rows:
        """Hand centres at p_OH (2, 3) along `axes` (A, 3), both in O; 2 A rows."""
        r, J = [], []
        directions = axes @ pose.R_WO.T
        for hand in range(2):
            t, f = self.terms, LEFT_HAND + hand
            error = t.p_WF[f] - pose.p_WO - pose.R_WO @ p_OH[hand]
            r.append(weight * directions @ error)
            J.append(weight * directions @ t.J_WF[f, :3])
        return np.concatenate(r), np.concatenate(J)

    def hand_pitch(self, sine: float, weight: float) -> Rows:
        """Both hands point down by an angle of the given sine, 2 rows."""
        t = self.terms
        r, J = [], []
        for f in (LEFT_HAND, LEFT_HAND + 1):
            x = t.R_WF[f, :, 0]
            r.append(weight * (-x[2] - sine))
            J.append(-weight * (t.J_WF[f, 3] * x[1] - t.J_WF[f, 4] * x[0]))
        return np.array(r), np.array(J)

    def com(self, xy: Array, weight: float, load: float, p_WO: Array) -> Rows:
        """Centre of mass of robot and load above `xy`, 2 rows."""
        t = self.terms
        share = t.mass_kg / (t.mass_kg + load)
        hands = 0.5 * (t.J_WF[LEFT_HAND, :2] + t.J_WF[LEFT_HAND + 1, :2])
        com = share * t.com[:2] + (1.0 - share) * p_WO[:2]
        return weight * (com - xy), weight * (share * t.J_com[:2] + (1.0 - share) * hands)

    def pelvis_turn(self, rpy: Array, weight: Array) -> Rows:
        """Roll, pitch, yaw of the pelvis, small roll and pitch, 3 rows."""
        t = self.terms
        R = t.R_WF[PELVIS]
        now = np.array(
            [np.arctan2(R[2, 1], R[2, 2]), np.arcsin(np.clip(-R[2, 0], -1, 1)), np.arctan2(R[1, 0], R[0, 0])]
        )
        return weight * (now - rpy), weight[:, None] * (rotation_z(-now[2]) @ t.J_WF[PELVIS, 3:])


@compiled
def _carried_points(J, r):
    """Jacobians (K, 3, 26) of points r (K, 3) off the place whose twist has the Jacobian J (6, 26)."""
    out = np.empty((len(r), 3, J.shape[1]))
    for i in range(len(r)):
        x, y, z = r[i]
        for k in range(J.shape[1]):
            wx, wy, wz = J[3, k], J[4, k], J[5, k]
            out[i, 0, k] = J[0, k] + wy * z - wz * y
            out[i, 1, k] = J[1, k] + wz * x - wx * z
            out[i, 2, k] = J[2, k] + wx * y - wy * x
    return out


def hinge(value: Array, J: Array, weight: float) -> Rows:
    """Rows that push values (K,) up to zero and leave them alone above it."""
    below = value < 0.0
    return np.where(below, weight * value, 0.0), np.where(below[:, None], weight * J, 0.0)
