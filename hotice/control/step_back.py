"""Stepping back slowly with an object in the hands: the weight is over one foot before the other moves.

The whole body shifts as one piece; the course of its shift and of the swing foot is known from the start.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hotice.control.path import ease

Array = NDArray[np.float64]
SOLE_AHEAD_M = 0.035  # middle of the sole ahead of the ankle
INWARD_M = 0.008  # where the weight goes: from the middle of the sole towards the other foot
SWING_HEIGHT_M = 0.04
SHIFT_S, SWING_S = 0.9, 0.6
LANDING_SHARE = 0.6  # of a shift, in which the foot that carries next may still look for the floor


@dataclass(frozen=True, kw_only=True)
class _Part:
    """One shift or swing: shift of the body (2,) at both ends [m], foot in the air (or -1), its place (3,) at both ends."""

    seconds: float
    shift: tuple[Array, Array]
    foot: int
    place: tuple[Array, Array]


@dataclass(frozen=True, kw_only=True)
class StepBack:
    """The course of stepping back; see `plan_step_back`."""

    parts: tuple[_Part, ...]
    feet: Array

    @property
    def seconds(self) -> float:
        """Length of the whole."""
        return sum(part.seconds for part in self.parts)

    def at(self, time_s: float) -> tuple[Array, int, int, Array, Array]:
        """Shift of the body (2,), foot in the air and foot that has just landed, or -1, where both ankles are, (2, 3), with their velocities, (2, 3)."""
        feet, velocity, landed = self.feet.copy(), np.zeros((2, 3)), -1
        for part in self.parts:
            share = min(time_s / part.seconds, 1.0)
            s = ease(share)
            shift = (1.0 - s) * part.shift[0] + s * part.shift[1]
            if part.foot >= 0:
                a, b = part.place
                feet[part.foot] = a + s * (b - a)
                if share < 1.0:
                    feet[part.foot, 2] += SWING_HEIGHT_M * math.sin(math.pi * s) ** 2
                    rate = 30.0 * share**2 * (1.0 - share) ** 2 / part.seconds
                    velocity[part.foot] = rate * (b - a)
                    velocity[part.foot, 2] += rate * SWING_HEIGHT_M * math.pi * math.sin(2.0 * math.pi * s)
            if time_s < part.seconds:
                return shift, part.foot, landed if share < LANDING_SHARE else -1, feet, velocity
            landed = part.foot
            time_s -= part.seconds
        return shift, -1, -1, feet, velocity


def plan_step_back(feet: Array, com: Array, distance_m: float, step_m: float = 0.12) -> StepBack:
    """Course of stepping back by a distance.

    Args:
        feet: (2, 3) ankles in the frame of the heading [m]; com: (2,) centre of mass of robot and load at the start.
        distance_m, step_m: how far in all, and the longest step.
    """
    count = max(math.ceil(distance_m / step_m), 1)
    step = np.array([-distance_m / count, 0.0, 0.0])
    now, shift, parts = feet.copy(), np.zeros(2), []
    inward = np.array([[SOLE_AHEAD_M, -INWARD_M], [SOLE_AHEAD_M, INWARD_M]])
    for _ in range(count):
        for swing in (0, 1):
            stance = 1 - swing
            over = now[stance, :2] + inward[stance] - com
            parts.append(_Part(seconds=SHIFT_S, shift=(shift, over), foot=-1, place=(now[swing], now[swing])))
            parts.append(_Part(seconds=SWING_S, shift=(over, over), foot=swing, place=(now[swing], now[swing] + step)))
            now = now.copy()
            now[swing] += step
            shift = over
    parts.append(_Part(seconds=SHIFT_S, shift=(shift, np.array([-distance_m, 0.0])), foot=-1, place=(now[0], now[0])))
    return StepBack(parts=tuple(parts), feet=feet.copy())
