"""Stance at the start of a pick-up: the frame G in which it is planned and done."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hotice import checks
from hotice.control.controller import Measurement
from hotice.control.pickup.footwork import SOLE_AHEAD_M
from hotice.control.whole_body.terms import FEET, Terms
from hotice.model.frames import quat_from_yaw, quat_mul, rotation_z

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Stance:
    """G in W: origin on the floor between the feet's soles at x, y [m]; its x axis is where they point, yaw [rad]."""

    x: float = 0.0
    y: float = 0.0
    yaw: float = 0.0

    def __post_init__(self) -> None:
        checks.numbers(self, checks.ANY)

    @classmethod
    def of(cls, terms: Terms, q: Array) -> Stance:
        """Stance of a standing configuration (27,) in W; `terms` serve as scratch."""
        terms.q[:], terms.v[:] = q, 0.0
        terms.refresh()
        ahead = terms.R_WF[FEET, :2, 0].sum(axis=0)
        ahead /= np.linalg.norm(ahead)
        x, y = terms.p_WF[FEET, :2].mean(axis=0) + SOLE_AHEAD_M * ahead
        return cls(float(x), float(y), float(np.arctan2(ahead[1], ahead[0])))

    def point(self, p_W: ArrayLike) -> Array:
        """Points (..., 3) of W, in G."""
        return self.direction(np.asarray(p_W, dtype=float) - [self.x, self.y, 0.0])

    def direction(self, v_W: ArrayLike) -> Array:
        """Directions (..., 3) of W, in G."""
        return np.asarray(v_W, dtype=float) @ rotation_z(self.yaw)

    def quat(self, quat_W: ArrayLike) -> Array:
        """Orientations (..., 4) in W, in G."""
        return np.asarray(quat_mul(quat_from_yaw(-self.yaw), quat_W), dtype=float)

    def measurement(self, m: Measurement) -> Measurement:
        """The same instant seen from G."""
        parts = {
            "p": self.point,
            "v": self.direction,
            "quat": self.quat,
            "foot": self.direction,
            "hand": self.direction,
        }
        names = ("p_WP", "quat_WP", "v_WP", "p_WO", "quat_WO", "v_WO", "foot_force_W", "hand_force_W")
        seen = {name: getattr(m, name) for name in names}
        return replace(m, **{n: None if v is None else parts[n.split("_")[0]](v) for n, v in seen.items()})
