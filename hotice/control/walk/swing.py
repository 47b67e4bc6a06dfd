"""Path of the swing foot: up, across, down, over what lies between.

Minimum-jerk pieces; the landing may move while the foot is in the air, so the horizontal part is planned anew from
where the reference is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def minimum_jerk(t: float, span: float, start: Array, speed: Array, accel: Array, end: Array) -> tuple[Array, ...]:
    """Position, velocity and acceleration at `t` of the quintic from (start, speed, accel) to rest at `end`.

    It starts at 0 and lasts `span` [s].
    """
    start, speed, accel, end = (np.asarray(v, dtype=float) for v in (start, speed, accel, end))
    if t >= span:
        return end, np.zeros_like(end), np.zeros_like(end)
    T = span
    d = end - start - speed * T - 0.5 * accel * T * T
    dv, da = -speed - accel * T, -accel
    c3 = (10 * d - 4 * dv * T + 0.5 * da * T * T) / T**3
    c4 = (-15 * d + 7 * dv * T - da * T * T) / T**4
    c5 = (6 * d - 3 * dv * T + 0.5 * da * T * T) / T**5
    t = max(t, 0.0)
    return (
        start + t * (speed + t * (0.5 * accel + t * (c3 + t * (c4 + t * c5)))),
        speed + t * (accel + t * (3 * c3 + t * (4 * c4 + t * 5 * c5))),
        accel + t * (6 * c3 + t * (12 * c4 + t * 20 * c5)),
    )


@dataclass(frozen=True, kw_only=True)
class SwingShape:
    """Timing of a swing in fractions of its time: feet lift until `rise`, travel `leave` to `arrive`, sink from `fall`.

    apex_m: height of the sole over the floor at the top [m].
    """

    apex_m: float = 0.07
    rise: float = 0.45
    leave: float = 0.0
    arrive: float = 0.95
    fall: float = 0.50

    def height(self, u: float) -> tuple[float, float, float]:
        """Height [m] and its first two derivatives by u at the fraction u of the time; from floor to floor."""
        if u < self.rise:
            z, v, a = minimum_jerk(u, self.rise, np.zeros(1), np.zeros(1), np.zeros(1), np.full(1, self.apex_m))
        elif u < self.fall:
            return self.apex_m, 0.0, 0.0
        else:
            span = 1.0 - self.fall
            z, v, a = minimum_jerk(u - self.fall, span, np.full(1, self.apex_m), np.zeros(1), np.zeros(1), np.zeros(1))
        return float(z[0]), float(v[0]), float(a[0])

    def travel(self, u: float) -> float:
        """Share of the way from take-off to landing at the fraction u of the time."""
        t = min(max((u - self.leave) / (self.arrive - self.leave), 0.0), 1.0)
        return t**3 * (10.0 + t * (-15.0 + 6.0 * t))


class Swing:
    """One swing: the reference of the foot's pose until it lands.

    Args:
        start: (3,) where the foot stands [m] and start_yaw [rad]; shape: see `SwingShape`; span_s: planned time [s].
    """

    def __init__(self, start: Array, start_yaw: float, shape: SwingShape, span_s: float) -> None:
        self.shape, self.span_s = shape, span_s
        self.start_z = float(start[2])
        self._xyw = np.array([start[0], start[1], start_yaw])
        self._speed, self._accel = np.zeros(3), np.zeros(3)
        self._time = 0.0
        self._tilt: tuple[float, float] | None = None

    def step(self, t: float, landing: Array, landing_yaw: float, remaining_s: float) -> tuple[Array, Array, Array]:
        """Pose (x, y, z, yaw), velocity and acceleration, (4,) each, at time t since take-off.

        Args:
            landing: (3,) [m], landing_yaw [rad]: where the foot is to land, as it is known now. remaining_s: when.
        """
        dt, self._time = t - self._time, t
        total = max(t + remaining_s, 1e-3)
        u = min(t / total, 1.0)
        if u >= self.shape.leave:
            left = max(total * self.shape.arrive - (t - dt), dt, 1e-3)
            goal = np.array([landing[0], landing[1], landing_yaw])
            self._xyw, self._speed, self._accel = minimum_jerk(dt, left, self._xyw, self._speed, self._accel, goal)
        z, dz, ddz = self.shape.height(u)
        ground = self.start_z + (landing[2] - self.start_z) * self.shape.travel(u)
        pose = np.array([self._xyw[0], self._xyw[1], ground + z, self._xyw[2]])
        speed = np.array([self._speed[0], self._speed[1], dz / total, self._speed[2]])
        accel = np.array([self._accel[0], self._accel[1], ddz / total**2, self._accel[2]])
        return pose, speed, accel

    def tilt(self, pitch: float, rise: float, dt: float) -> tuple[float, float]:
        """Rates of the foot's pitch [rad/s] and of its rise for the toe [m/s] since the step before."""
        before, self._tilt = self._tilt or (pitch, rise), (pitch, rise)
        return ((pitch - before[0]) / dt, (rise - before[1]) / dt) if dt > 0.0 else (0.0, 0.0)
