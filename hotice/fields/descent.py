"""Ways that points take along a guidance field."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hotice.fields.hod_pf import GuidanceField


def descend(
    guide: GuidanceField, starts_W: NDArray[np.float64], *, step_m: float = 0.01, length_m: float = 4.0
) -> NDArray[np.float64]:
    """Paths along F / |F| from points (n, 3) in W [m] to 5 cm from the goal, midpoint rule -> (steps + 1, n, 3)."""

    def direction(p_W: NDArray[np.float64]) -> NDArray[np.float64]:
        force = guide.sample(p_W)
        return force / np.maximum(np.linalg.norm(force, axis=-1, keepdims=True), 1e-9)

    p_W = np.array(starts_W, dtype=np.float64)
    path = [p_W]
    for _ in range(round(length_m / step_m)):
        go_on = guide.extended_geodesic_distance(p_W)[:, None] > 0.05
        if not go_on.any():
            break
        p_W = p_W + go_on * step_m * direction(p_W + 0.5 * step_m * direction(p_W))
        path.append(p_W)
    return np.stack(path)
