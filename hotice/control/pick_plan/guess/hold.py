"""First guess of grasp and carry state together, for a grasp is worth as much as the carry state that it leads to.

Hands that hold an object keep their poses relative to each other, and with locked wrists that leaves two arms of four
joints next to no choice: where the object comes to be, level, before an upright pelvis, follows from the grasp alone.
One least-squares problem over both configurations therefore chooses the hold.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hotice.control.pick_plan.guess.postures import ARM_WEIGHT, Guess, posture_weights
from hotice.control.pick_plan.guess.rows import Pose, Rows
from hotice.control.pick_plan.task import Frames, ObjectPose
from hotice.control.whole_body.terms import HANDS, LEFT_HAND, NV, PELVIS
from hotice.model import g1
from hotice.model.frames import quat_from_yaw
from hotice.model.least_squares import minimize

Array = NDArray[np.float64]
N = 2 * NV + 4
GRASP, CARRY, PLACE, YAW = slice(0, NV), slice(NV, 2 * NV), slice(2 * NV, 2 * NV + 3), 2 * NV + 3
"""The unknowns: increments of both configurations, the carried object off its place [m], its yaw [rad]."""
ARMS = slice(6 + g1.UPPER.start, 6 + g1.UPPER.stop)
HOLD = (200.0, 40.0)
PLACE_WEIGHT, YAW_WEIGHT, COM_WEIGHT = np.array([8.0, 20.0, 10.0]), 4.0, 12.0
HEIGHT_WEIGHT, TURN_WEIGHT, POSTURE_WEIGHT = 100.0, 20.0, 0.3
TRAVEL_WEIGHT = 0.3
"""Weight of how far the arms at the grasp are from the carry state's: between stretched and bent arms the retreat has
to turn the body aside."""
STARTS = ((0.0, 0.0, 0.0), (0.2, -0.1, 0.25), (0.5, -0.05, 0.0), (0.0, -0.25, 0.7), (0.3, -0.3, 0.8))
"""Lean [rad], drop of the pelvis [m] and half the bend of the knees [rad] to start the grasp from."""
ROUGH, EXACT = (12.0, 2.0), (300.0, 0.3)
"""Weights of palms and of the pelvis' heading at the grasp: first to get near, then to touch."""


@dataclass(frozen=True, kw_only=True)
class Together:
    """Grasp and carry state (27,), where the object is in the latter, and what they cost."""

    grasp: Array
    carry: Array
    at: ObjectPose
    cost: float


def grasp_and_carry(guess: Guess) -> Together:
    """The best over `STARTS`."""
    problem = _Problem(guess)
    return min((problem.solve(*start) for start in STARTS), key=lambda found: found.cost)


class _Problem:
    def __init__(self, guess: Guess) -> None:
        task, carry = guess.task, guess.task.grip.carry
        self.guess, self.task, self.terms, self.pin = guess, task, guess.terms, guess.terms._pin
        self.wish = carry.joint_pos
        self.grasp = np.concatenate([task.q_start[:7], self.wish])
        self.carry = np.concatenate([carry.root_pos_W, np.roll(carry.quat_WP, -1), self.wish])
        self.pose = Pose(self.terms)

    def solve(self, lean: float, drop: float, bend: float) -> Together:
        x, (lower, upper) = np.zeros(N), self.guess.joint_bounds()
        x[2], x[4] = drop, lean
        for first in (6, 12):
            x[first], x[first + 3], x[first + 4] = -bend - lean, 2.0 * bend, -bend
        six, four = np.full(6, 1.5), np.full(4, 0.5)
        low = np.concatenate([-six, lower - self.wish, -six, lower - self.wish, -four])
        high = np.concatenate([six, upper - self.wish, six, upper - self.wish, four])
        self.terms.v[:] = 0.0
        for weights in (ROUGH, EXACT):
            x = minimize(lambda v, w=weights: self.rows(v, *w), x, low, high, max_steps=120, step_tolerance=1e-5)
        r, _ = self.rows(x, *EXACT)
        return Together(
            grasp=self._at(self.grasp, x[GRASP])[0],
            carry=self._at(self.carry, x[CARRY])[0],
            at=self._object(x),
            cost=float(r @ r),
        )

    def rows(self, x: Array, stiff: float, turn: float) -> Rows:
        """Residuals and their Jacobian (R, N)."""
        t, task, p = self.terms, self.task, self.pose
        _, by_x = self._at(self.grasp, x[GRASP])
        found = [
            _wide(row, GRASP, by_x)
            for row in [*self.guess.grasp_rows(p, stiff, turn), self._posture(posture_weights(ARM_WEIGHT))]
        ]
        hands = Frames(p=t.p_WF[HANDS].copy(), R=t.R_WF[HANDS].copy())
        J_hands, joints = t.J_WF[HANDS] @ by_x, t.q[g1.JOINT_POS].copy()
        _, by_x = self._at(self.carry, x[CARRY])
        at, height = self._object(x), HEIGHT_WEIGHT * (t.p_WF[PELVIS, 2:3] - self.carry[2])
        found += [
            _wide(row, CARRY, by_x)
            for row in [
                *self.guess.stand_rows(p, task.grip.carried.mass_kg, at.p_WO),
                p.com(np.zeros(2), COM_WEIGHT, task.grip.carried.mass_kg, at.p_WO),
                (height, HEIGHT_WEIGHT * t.J_WF[PELVIS, 2:3]),
                p.pelvis_turn(np.zeros(3), np.full(3, TURN_WEIGHT)),
                self._posture(posture_weights(POSTURE_WEIGHT)),
            ]
        ]
        found += [self._hold(i, hands, J_hands[i], at, by_x) for i in range(2)]
        travel = np.zeros((8, N))
        travel[:, CARRY], travel[:, GRASP] = TRAVEL_WEIGHT * np.eye(NV)[ARMS], -TRAVEL_WEIGHT * np.eye(NV)[ARMS]
        found.append((TRAVEL_WEIGHT * (t.q[g1.JOINT_POS] - joints)[g1.UPPER], travel))
        weight = np.append(PLACE_WEIGHT, YAW_WEIGHT)
        found.append((weight * x[2 * NV :], np.hstack([np.zeros((4, 2 * NV)), np.diag(weight)])))
        return np.concatenate([r for r, _ in found]), np.concatenate([J for _, J in found])

    def _hold(self, hand: int, hands: Frames, J_grasp: Array, at: ObjectPose, by_x: Array) -> Rows:
        """A hand of the carry state is where the object takes that of the grasp, 6 rows."""
        turn, up, (far, bent) = at.R_WO @ self.task.pose.R_WO.T, np.array([0.0, 0.0, 1.0]), HOLD
        off = turn @ (hands.p[hand] - self.task.pose.p_WO)
        r, J = _wide(self.pose.frame(LEFT_HAND + hand, at.p_WO + off, turn @ hands.R[hand], HOLD), CARRY, by_x)
        J[:3, GRASP], J[3:, GRASP] = -far * turn @ J_grasp[:3], -bent * turn @ J_grasp[3:]
        J[:3, PLACE], J[:3, YAW], J[3:, YAW] = -far * np.eye(3), -far * np.cross(up, off), -bent * up
        return r, J

    def _posture(self, weight: Array) -> Rows:
        J = np.zeros((20, NV))
        J[:, 6:] = np.diag(weight)
        return weight * (self.terms.q[g1.JOINT_POS] - self.wish), J

    def _object(self, x: Array) -> ObjectPose:
        return ObjectPose.of(self.task.final.p_WO + x[PLACE], quat_from_yaw(float(x[YAW])))

    def _at(self, nominal: Array, x: Array) -> tuple[Array, Array]:
        """Puts `terms` at `nominal` (27,) moved by x (26,); returns that configuration and dv/dx (26, 26)."""
        t = self.terms
        t.q[:] = self.pin.integrate(t.model, nominal, x)
        t.refresh()
        return t.q.copy(), self.pin.dIntegrate(t.model, nominal, x, self.pin.ARG1)


def _wide(row: Rows, columns: slice, by_x: Array) -> Rows:
    """Rows of one configuration as rows of all unknowns."""
    r, by_v = row
    J = np.zeros((len(r), N))
    J[:, columns] = by_v @ by_x
    return r, J
