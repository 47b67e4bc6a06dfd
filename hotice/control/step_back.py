"""Stepping back with an object in the hands: small steps whose course is known from the start.

The zero-moment point rests under the standing foot while the other swings and moves over while both stand; the centre of mass
is the only course p = c − (h/g) c̈ that has it and stays bounded, solved as one banded system. The body shifts as one piece.
Linear inverted pendulum: Kajita et al., Biped walking pattern generation by using preview control of zero-moment point, 2003.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hotice.control.path import ease

Array = NDArray[np.float64]
GRAVITY = 9.81
SOLE_AHEAD_M = 0.035  # middle of the sole ahead of the ankle
INWARD_M = 0.008  # where the weight rests: from the middle of the sole towards the other foot
SWING_HEIGHT_M = 0.04
FIRST_S, SWING_S, BOTH_S, LAST_S = 0.9, 0.5, 0.25, 1.0
LANDING_S = 0.2  # after a swing, in which its foot may still look for the floor
GRID_S = 0.005


@dataclass(frozen=True, kw_only=True)
class _Swing:
    begin_s: float
    foot: int
    place: tuple[Array, Array]


@dataclass(frozen=True, kw_only=True)
class StepBack:
    """The course of stepping back; see `plan_step_back`. com, com_acc: (T, 2) every `GRID_S`; feet: (2, 3) at the start."""

    swings: tuple[_Swing, ...]
    feet: Array
    com: Array
    com_acc: Array

    @property
    def seconds(self) -> float:
        """Length of the whole."""
        return (len(self.com) - 1) * GRID_S

    def shift(self, time_s: float) -> tuple[Array, Array]:
        """How far the body has moved (2,) [m], and its acceleration (2,)."""
        place = min(max(time_s / GRID_S, 0.0), len(self.com) - 1.0)
        i = min(int(place), len(self.com) - 2)
        s = place - i
        return (1 - s) * self.com[i] + s * self.com[i + 1] - self.com[0], (1 - s) * self.com_acc[i] + s * self.com_acc[
            i + 1
        ]

    def feet_at(self, time_s: float) -> tuple[int, int, Array, Array]:
        """Foot in the air and foot that has just landed, or -1; where the ankles are, (2, 3), and their velocities, (2, 3)."""
        feet, velocity, air, landed = self.feet.copy(), np.zeros((2, 3)), -1, -1
        for swing in self.swings:
            a, b = swing.place
            share = (time_s - swing.begin_s) / SWING_S
            if share < 0.0:
                break
            s = ease(share)
            feet[swing.foot] = a + s * (b - a)
            if share < 1.0:
                air = swing.foot
                feet[air, 2] += SWING_HEIGHT_M * math.sin(math.pi * s) ** 2
                rate = 30.0 * share**2 * (1.0 - share) ** 2 / SWING_S
                velocity[air] = rate * (b - a)
                velocity[air, 2] += rate * SWING_HEIGHT_M * math.pi * math.sin(2.0 * math.pi * s)
            elif time_s < swing.begin_s + SWING_S + LANDING_S:
                landed = swing.foot
        return air, landed, feet, velocity


def plan_step_back(feet: Array, com: Array, height_m: float, distance_m: float, step_m: float = 0.15) -> StepBack:
    """Course of stepping back by a distance.

    Args:
        feet: (2, 3) ankles in the frame of the heading [m]; com: (2,) centre of mass of robot and load, at rest.
        height_m: of the centre of mass above the soles; distance_m, step_m: how far in all, and the longest step.
    """
    count = max(math.ceil(distance_m / step_m), 1)
    step = np.array([-distance_m / count, 0.0, 0.0])
    inward = np.array([[SOLE_AHEAD_M, -INWARD_M], [SOLE_AHEAD_M, INWARD_M]])
    now, swings, t = feet.copy(), [], FIRST_S
    times, zmp = [0.0, 0.3 * FIRST_S], [com, com]
    for _ in range(count):
        for swing in (0, 1):
            stance = now[1 - swing, :2] + inward[1 - swing]
            swings.append(_Swing(begin_s=t, foot=swing, place=(now[swing].copy(), now[swing] + step)))
            times += [t, t + SWING_S]
            zmp += [stance, stance]
            now[swing] += step
            t += SWING_S + BOTH_S
    end = com + step[:2] * count
    times += [t - BOTH_S + 0.5 * LAST_S, t - BOTH_S + LAST_S]
    zmp += [end, end]
    grid = np.arange(0.0, times[-1] + 1e-9, GRID_S)
    p = np.stack([np.interp(grid, times, np.array(zmp)[:, i]) for i in range(2)], axis=1)
    course = _pendulum(p, height_m)
    acceleration = GRAVITY / height_m * (course - p)
    acceleration[[0, -1]] = 0.0
    return StepBack(swings=tuple(swings), feet=feet.copy(), com=course, com_acc=acceleration)


def _pendulum(p: Array, height_m: float) -> Array:
    """Centre of mass (T, 2) whose zero-moment point is p (T, 2), starting and ending over it."""
    from scipy.linalg import solve_banded

    k = height_m / GRAVITY / GRID_S**2
    n = len(p)
    bands = np.zeros((3, n))
    bands[0, 2:], bands[1, 1:-1], bands[2, :-2] = -k, 1.0 + 2.0 * k, -k
    bands[1, [0, -1]] = 1.0
    return solve_banded((1, 1), bands, p)
