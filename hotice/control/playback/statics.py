"""Static torques of a robot that stands with its hands on an object: gravity less what floor and object push."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hotice.control.whole_body.terms import HANDS, LEFT_FOOT, LEFT_HAND, RIGHT_FOOT, Terms
from hotice.model.frames import GRAVITY

Array = NDArray[np.float64]


def static_torque(
    terms: Terms, q: Array, press_N: float, load_kg: float, p_HO: Array, hand_point: Array
) -> tuple[Array, Array]:
    """Torques that hold a configuration (27,), the robot standing on both feet.

    The floor pushes straight up under the common centre of mass, each foot by its share; the object pushes the hands
    apart along the line between the points at which they press, and half of its weight hangs on each.

    Args:
        terms: scratch. press_N: force between each hand and the object. load_kg: how much of it the hands carry.
        p_HO: (2, 3) where the load hangs, hand_point: (2, 3) where the hands press, in the hand frames [m].

    Returns:
        The joints' torques (20,) [N m], and what is missing at the pelvis, (6,), which is nothing but rounding where
        the pushes are in balance.
    """
    terms.q[:], terms.v[:] = q, 0.0
    terms.refresh()
    p, R = terms.p_WF, terms.R_WF
    arm = np.einsum("hij,hj->hi", R[HANDS], hand_point)
    hang = np.einsum("hij,hj->hi", R[HANDS], p_HO)
    press = p[HANDS] + arm
    line = (press[0] - press[1]) / np.linalg.norm(press[0] - press[1])
    wrench = np.zeros((len(p), 6))
    weight = np.array([0.0, 0.0, -0.5 * load_kg * GRAVITY])
    for hand, sign in enumerate((1.0, -1.0)):
        push = sign * press_N * line
        wrench[LEFT_HAND + hand] = [*(push + weight), *(np.cross(arm[hand], push) + np.cross(hang[hand], weight))]
    held = (p[HANDS] + hang).mean(axis=0)
    mass = terms.mass_kg + load_kg
    com = (terms.mass_kg * terms.com + load_kg * held) / mass
    left = (com[1] - p[RIGHT_FOOT, 1]) / (p[LEFT_FOOT, 1] - p[RIGHT_FOOT, 1])
    for foot, share in ((LEFT_FOOT, left), (RIGHT_FOOT, 1.0 - left)):
        push = np.array([0.0, 0.0, share * mass * GRAVITY])
        wrench[foot] = [*push, *np.cross([com[0] - p[foot, 0], 0.0, -p[foot, 2]], push)]
    torque = terms.h - np.einsum("fkv,fk->v", terms.J_WF, wrench)
    return torque[6:].copy(), torque[:6].copy()
