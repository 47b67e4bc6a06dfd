"""Configurations as a function of time: smooth from rest to rest through a row of keyframes."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def ease(share: float) -> float:
    """Minimum-jerk course from 0 to 1 while `share` goes from 0 to 1, held outside."""
    s = min(max(share, 0.0), 1.0)
    return s * s * s * (10.0 + s * (6.0 * s - 15.0))


def along(pin: Any, model: Any, knots: Array, share: float) -> Array:
    """Configuration at `share` of the way through `knots` (K, 27), equally spaced in time, eased at both ends."""
    place = ease(share) * (len(knots) - 1)
    i = min(int(place), len(knots) - 2)
    return pin.interpolate(model, knots[i], knots[i + 1], place - i)
