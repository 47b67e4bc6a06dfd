"""Divergent component of motion of the linear inverted pendulum, in closed form.

xi = x + xdot/omega diverges from the zero-moment point z by xi' = omega (xi - z); the centre of mass x converges to xi.
For a zero-moment point that is piecewise linear in time the reference that ends at rest follows backwards, segment by
segment (Englsberger, Ott, Albu-Schaeffer 2015): with z(t) = z0 + m t,

    xi(t) = z(t) + m/omega + exp(omega (t - T)) (xi(T) - z(T) - m/omega).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hotice.errors import InvalidConfig
from hotice.model.frames import GRAVITY

LEAST_M = 0.3
"""A lower centre of mass is not believed: omega must stay finite."""
Array = NDArray[np.float64]


def natural_frequency(com_height_m: float) -> float:
    """Omega = sqrt(g / height of the centre of mass over the soles) [1/s]; of a robot that falls, as `LEAST_M` high."""
    return float(np.sqrt(GRAVITY / max(com_height_m, LEAST_M)))


@dataclass(frozen=True, eq=False)
class DcmReference:
    """The DCM that follows a piecewise linear zero-moment point and ends at rest on its last value.

    Attributes:
        time: (K,) ascending [s]. zmp: (K, 2) at these times [m]. dcm: (K, 2) at these times [m]. omega: [1/s].
    """

    time: Array
    zmp: Array
    dcm: Array
    omega: float

    @classmethod
    def through(cls, time: Array, zmp: Array, omega: float) -> DcmReference:
        """Backward recursion from rest at the last zero-moment point. Raises `InvalidConfig`."""
        time, zmp = np.asarray(time, dtype=float), np.asarray(zmp, dtype=float)
        if zmp.shape != (len(time), 2) or len(time) < 1 or (np.diff(time) <= 0).any():
            raise InvalidConfig(
                f"times {time.shape} and zero-moment points {zmp.shape}: K ascending times and K x 2 points are needed"
            )
        dcm = zmp.copy()
        for k in range(len(time) - 2, -1, -1):
            span = time[k + 1] - time[k]
            lead = (zmp[k + 1] - zmp[k]) / span / omega
            dcm[k] = zmp[k] + lead + np.exp(-omega * span) * (dcm[k + 1] - zmp[k + 1] - lead)
        return cls(time, zmp, dcm, omega)

    def at(self, t: float) -> tuple[Array, Array, Array]:
        """DCM (2,) [m], its velocity (2,) [m/s] and the zero-moment point (2,) [m] at time t; constant outside."""
        if t >= self.time[-1]:
            return self.dcm[-1], np.zeros(2), self.zmp[-1]
        k = max(0, int(np.searchsorted(self.time, t, side="right")) - 1)
        t = max(t, float(self.time[0]))
        span = self.time[k + 1] - self.time[k]
        slope = (self.zmp[k + 1] - self.zmp[k]) / span
        zmp = self.zmp[k] + slope * (t - self.time[k])
        lead = slope / self.omega
        dcm = zmp + lead + np.exp(self.omega * (t - self.time[k])) * (self.dcm[k] - self.zmp[k] - lead)
        return dcm, self.omega * (dcm - zmp), zmp
