"""What comes out of a policy's network."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def next_action(raw: Array, limit: float) -> Array:
    """What the environment makes of a network's finite output (20,): within ± `limit`."""
    return np.minimum(np.maximum(raw, -limit), limit)
