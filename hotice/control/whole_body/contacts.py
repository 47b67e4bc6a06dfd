"""Contacts: four points per foot on the floor, one per hand on the object, linearised friction cones, the load.

The object's mass enters as the load of the hands: m (a_O − g) = −Σ f over both hands, where a_O is the mean
acceleration of the points at which they hold it.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from hotice.compiled import compiled
from hotice.model.frames import GRAVITY

Array = NDArray[np.float64]
FOOT_POINTS = 4
SOLE_POINTS_M = np.array(
    [
        [[-0.05, s * 0.025, -0.035], [-0.05, -s * 0.025, -0.035], [0.12, s * 0.03, -0.035], [0.12, -s * 0.03, -0.035]]
        for s in (1.0, -1.0)
    ]
)
"""(2, 4, 3) where the soles touch the floor, in the frame of the ankle-roll link [m]; a test holds them to g1.xml."""
PALM_M = np.array([[0.0, -0.02, 0.0], [0.0, 0.02, 0.0]])
"""(2, 3) middle of the palms' surfaces in the hand frames [m]."""
CONE_ROWS = 5 * (2 * FOOT_POINTS + 2)


@dataclass(kw_only=True)
class Contacts:
    """Contacts at one instant; arrays that are written in place.

    Attributes:
        foot_force_max_n: (2,) largest normal force of each sole point; 0 where the foot is in the air.
        hand_normal_W: (2, 3) unit, from the object into the hand. hand_force_ref_W: (2, 3) target force on each hand
            [N], beside the load. hand_force_max_n: (2,) largest normal force; 0 where the hand is free.
        hand_point: (2, 3) where the force acts, in the hand frame [m]: the middle of the palm's surface.
        hand_moment_W: (2, 3) known moments on the hands [N m]: of a load whose centre is not between the palms.
        load_kg: mass that the hands carry, 0 while a support carries it.
    """

    foot_force_max_n: Array = field(default_factory=lambda: np.full(2, 400.0))
    hand_normal_W: Array = field(default_factory=lambda: np.array([[0.0, 1.0, 0.0], [0.0, -1.0, 0.0]]))
    hand_force_ref_W: Array = field(default_factory=lambda: np.zeros((2, 3)))
    hand_force_max_n: Array = field(default_factory=lambda: np.zeros(2))
    hand_point: Array = field(default_factory=lambda: PALM_M.copy())
    hand_moment_W: Array = field(default_factory=lambda: np.zeros((2, 3)))
    load_kg: float = 0.0


@compiled
def stack_feet(J_WF, R_WF, points, friction, force_max, A, C, upper, first_cone):
    """Foot forces into the base rows of A, the joint rows of C (both as −Jᵀ f), and the bounds of their cones."""
    for foot in range(2):
        J, R = J_WF[1 + foot], R_WF[1 + foot]
        for i in range(FOOT_POINTS):
            r = R @ points[foot, i]
            column = 26 + 3 * (FOOT_POINTS * foot + i)
            for k in range(26):
                wx, wy, wz = J[3, k], J[4, k], J[5, k]
                x, y, z = (
                    J[0, k] + wy * r[2] - wz * r[1],
                    J[1, k] + wz * r[0] - wx * r[2],
                    J[2, k] + wx * r[1] - wy * r[0],
                )
                if k < 6:
                    A[k, column], A[k, column + 1], A[k, column + 2] = -x, -y, -z
                else:
                    C[k - 6, column], C[k - 6, column + 1], C[k - 6, column + 2] = -x, -y, -z
            row = first_cone + 5 * (FOOT_POINTS * foot + i)
            for c in range(2):
                C[row + 2 * c, column + c], C[row + 2 * c, column + 2] = 1.0, -friction
                C[row + 2 * c + 1, column + c], C[row + 2 * c + 1, column + 2] = -1.0, -friction
            C[row + 4, column + 2] = 1.0
            upper[row + 4] = force_max[foot]


@compiled
def stack_hands(J_WF, R_WF, v_WF, drift_WF, points, normal, friction, force_max, load, A, b, C, upper, first_cone):
    """Hand forces as the feet's; rows 6 to 8 of A a + … = b are Newton's law of the load."""
    for c in range(3):
        b[6 + c] = 0.0
        A[6 + c] = 0.0
    b[8] = -load * GRAVITY
    t = np.empty((2, 3))
    for hand in range(2):
        J, r, w = J_WF[3 + hand], R_WF[3 + hand] @ points[hand], v_WF[3 + hand, 3:]
        column = 26 + 6 * FOOT_POINTS + 3 * hand
        p = np.empty(3)
        for k in range(26):
            wx, wy, wz = J[3, k], J[4, k], J[5, k]
            p[0], p[1], p[2] = (
                J[0, k] + wy * r[2] - wz * r[1],
                J[1, k] + wz * r[0] - wx * r[2],
                J[2, k] + wx * r[1] - wy * r[0],
            )
            for c in range(3):
                A[6 + c, k] += 0.5 * load * p[c]
                if k < 6:
                    A[k, column + c] = -p[c]
                else:
                    C[k - 6, column + c] = -p[c]
        d, u = drift_WF[3 + hand], np.cross(w, r)
        drift = d[:3] + np.cross(d[3:], r) + np.cross(w, u)
        for c in range(3):
            b[6 + c] -= 0.5 * load * drift[c]
            if load > 0.0:
                A[6 + c, column + c] = 1.0
        n = normal[hand]
        axis = np.array([0.0, 0.0, 1.0]) if abs(n[2]) < 0.7 else np.array([1.0, 0.0, 0.0])
        t[0] = np.cross(axis, n)
        t[0] /= np.sqrt(t[0] @ t[0])
        t[1] = np.cross(n, t[0])
        row = first_cone + 5 * (2 * FOOT_POINTS + hand)
        for c in range(3):
            for i in range(2):
                C[row + 2 * i, column + c] = t[i, c] - friction * n[c]
                C[row + 2 * i + 1, column + c] = -t[i, c] - friction * n[c]
            C[row + 4, column + c] = n[c]
        upper[row + 4] = force_max[hand]


@compiled
def add_moments(J_WF, moments, h, out):
    """Bias forces h (26,) less what known moments on the hands do, into `out`."""
    out[:] = h
    for hand in range(2):
        for k in range(26):
            for c in range(3):
                out[k] -= J_WF[3 + hand, 3 + c, k] * moments[hand, c]
