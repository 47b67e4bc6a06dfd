"""Support of an object before it is picked up."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hotice.errors import PickInfeasible

SUPPORT_TOP_M = (0.40, 0.85)
NEAR_M = (0.15, 0.60)


@dataclass(frozen=True, kw_only=True)
class Support:
    """What the object stands on: height of its top [m] and distance of its near edge ahead of the feet's middle [m]."""

    top_m: float
    near_m: float

    def __post_init__(self) -> None:
        low, high = SUPPORT_TOP_M
        if not (np.isfinite(self.top_m) and low <= self.top_m <= high):
            raise PickInfeasible(f"support top at {self.top_m:.2f} m: allowed are {low:.2f} to {high:.2f} m")
        low, high = NEAR_M
        if not (np.isfinite(self.near_m) and low <= self.near_m <= high):
            raise PickInfeasible(
                f"support edge {self.near_m:.2f} m ahead of the feet: allowed are {low:.2f} to {high:.2f} m, "
                "stand nearer or farther"
            )
