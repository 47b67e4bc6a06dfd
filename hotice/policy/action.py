"""What goes into a policy that stands still, and what comes out of its network."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hotice.policy.guidance import FieldReading

Array = NDArray[np.float64]


def next_action(raw: Array, limit: float) -> Array:
    """What the environment makes of a network's finite output (20,): within ± `limit`."""
    return np.minimum(np.maximum(raw, -limit), limit)


def standing(reading: FieldReading) -> FieldReading:
    """The reading of a robot that is to stand where it is: no command, as at the goal."""
    still = FieldReading(reading.vector.copy())
    for name in ("c_W", "speed", "heading_error", "goal_distance"):
        still.vector[FieldReading.PARTS[name]] = 0.0
    return still
