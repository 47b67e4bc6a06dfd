"""Pushes of students and of evaluation: sudden changes of the pelvis' velocity at random times. NumPy or torch."""

from __future__ import annotations

import math
from typing import Any

from hotice.arrays import namespace
from hotice.model.dynamics import LEAST_PUSH


def push_velocity(hit: Any, angle: Any, share: Any, size_m_s: float, chance: float) -> Any:
    """Change of velocity along x and y of W, (..., 2) [m/s], at a control step; zero where none comes.

    Args:
        hit, angle, share: (...) uniform draws in [0, 1): whether, where to, how much.
        size_m_s: largest push; the least is `LEAST_PUSH` of it. chance: of a push in this step.
    """
    xp, turn = namespace(hit), 2.0 * math.pi * angle
    size = size_m_s * (LEAST_PUSH + (1.0 - LEAST_PUSH) * share) * (hit < chance)
    return size[..., None] * xp.stack([xp.cos(turn), xp.sin(turn)], -1)
