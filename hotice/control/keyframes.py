"""Whole-body inverse kinematics for picking up: planted feet, palms on the object, mass over the feet, no collision.

All wishes are rows of one bounded least-squares problem over the 26 coordinates of robot pose and joints, solved by
`hotice.model.least_squares`: hard ones weigh most. Coordinates are increments from a nominal configuration.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hotice.compiled import compiled
from hotice.control.terms import LEFT_FOOT, LEFT_HAND, NV, PELVIS, RIGHT_FOOT, Terms
from hotice.model.carry import surface_distance
from hotice.model.frames import quat_to_mat
from hotice.model.least_squares import minimize
from hotice.model.objects import CarriedObject

Array = NDArray[np.float64]
Rows = tuple[Array, Array]
PALM_POINTS_M = np.array([[sx * 0.04, 0.0, sz * 0.025] for sx in (-1, 1) for sz in (-1, 1)])
"""Centres of the palm spheres in the hand frame; a test holds them to g1.xml."""
PALM_RADIUS_M = 0.02


@dataclass(frozen=True, kw_only=True)
class ObjectPose:
    """Where the object is: p_WO (3,) [m], R_WO (3, 3)."""

    p_WO: Array
    R_WO: Array

    @classmethod
    def of(cls, p_WO: ArrayLike, quat_WO: ArrayLike) -> ObjectPose:
        """From a quaternion wxyz."""
        return cls(p_WO=np.array(p_WO, dtype=float), R_WO=np.asarray(quat_to_mat(quat_WO), dtype=np.float64))


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
        c, s = np.cos(now[2]), np.sin(now[2])
        heading = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
        return weight * (now - rpy), weight[:, None] * (heading @ t.J_WF[PELVIS, 3:])


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


Residual = Callable[[Pose], list[Rows]]


class KeyframeIk:
    """Solves for configurations q (27,) of Pinocchio's order; `posture` pulls the joints (weights (20,))."""

    def __init__(self, terms: Terms) -> None:
        self.terms = terms
        self._pin = terms._pin

    def solve(
        self, nominal: Array, posture: Array, weight: Array, rows: Residual, *, start: Array | None = None
    ) -> Array:
        """The least-squares configuration near `nominal` (27,), from `start` (26,) increments."""
        t, pin = self.terms, self._pin
        lower = np.concatenate([np.full(6, -1.5), t.lower + 0.03 - nominal[7:]])
        upper = np.concatenate([np.full(6, 1.5), t.upper - 0.03 - nominal[7:]])
        t.v[:] = 0.0
        pose = Pose(t)
        eye = np.zeros((20, NV))
        eye[:, 6:] = np.diag(weight)

        def residual(x: Array) -> Rows:
            t.q[:] = pin.integrate(t.model, nominal, x)
            t.refresh()
            found = rows(pose)
            found.append((weight * (t.q[7:] - posture), eye))
            J = np.concatenate([j for _, j in found])
            return np.concatenate([r for r, _ in found]), J @ pin.dIntegrate(t.model, nominal, x, pin.ARG1)

        found = minimize(
            residual, np.zeros(NV) if start is None else start, lower, upper, max_steps=120, step_tolerance=1e-5
        )
        residual(found)
        return t.q.copy()


def hinge(value: Array, J: Array, weight: float) -> Rows:
    """Rows that push values (K,) up to zero and leave them alone above it."""
    below = value < 0.0
    return np.where(below, weight * value, 0.0), np.where(below[:, None], weight * J, 0.0)


FEET = (LEFT_FOOT, RIGHT_FOOT)
