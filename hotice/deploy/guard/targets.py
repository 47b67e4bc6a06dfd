"""The runner's targets as the guard follows them: judged one by one, the last good ones kept, their age watched."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from hotice.deploy.command import LIMITS
from hotice.deploy.guard.limits import GuardLimits
from hotice.model import g1

STEP_S = 0.02
"""Time for which `step_rad` holds [s]."""
EARLY_S = 0.005
"""How far in the future a stamp may be [s]: none on one machine's clock, but for its resolution."""
_KP = g1.gains(g1.ALL_JOINTS)[0]


def refusal(
    targets: np.ndarray, before: np.ndarray | None, q_measured: np.ndarray | None, now_s: float, limits: GuardLimits
) -> str:
    """Why targets () must not be followed, naming the joint; empty if they may be.

    Args:
        targets: the record; before: the last good one, None at the start
        q_measured: (29,) [rad]; None while motors do not follow the targets, which may be far away then
        now_s: on the clock of the stamp [s]
        limits: see there
    """
    q, tau = targets["q"], targets["tau"]
    ages = np.array([targets["box_age_s"], targets["pose_age_s"]])
    if not (np.isfinite(q).all() and np.isfinite(tau).all() and np.isfinite(targets["stamp_s"])):
        return f"a number of {_worst(~(np.isfinite(q) & np.isfinite(tau)))} is not finite"
    if np.isnan(ages).any() or (ages < 0.0).any():
        return "the age of box or pose is no number from 0 on"
    if targets["stamp_s"] > now_s + EARLY_S:
        return f"stamped {targets['stamp_s'] - now_s:.3g} s in the future"
    outside = np.maximum(LIMITS.lower - q, q - LIMITS.upper)
    if (outside > limits.range_rad).any():
        return f"{_worst(outside)} is {outside.max():.3g} rad beyond its range: {limits.range_rad:g} are allowed"
    torque = _asked(targets, q_measured)
    # a joint that its load has pushed away from where it was told to stay is not the new target's fault: what is sent
    # stays within the torque anyway
    worse = torque if before is None else np.where(torque > _asked(before, q_measured) + _SAME, torque, 0.0)
    if (worse > limits.torque_share).any() or (np.abs(tau) > LIMITS.torque).any():
        worst = np.maximum(worse, np.abs(tau) / LIMITS.torque)
        return f"{_worst(worst)} is asked for {worst.max():.3g} of its torque: {limits.torque_share:g} is allowed"
    if before is not None:
        steps = max(1.0, float(targets["stamp_s"] - before["stamp_s"]) / STEP_S)
        step = np.abs(q - before["q"])
        if (step > limits.step_rad * steps).any():
            return f"{_worst(step)} steps by {step.max():.3g} rad: {limits.step_rad * steps:.3g} are allowed"
    return ""


class Targets:
    """Follows a slot's targets."""

    def __init__(self, read: Callable[[], np.ndarray | None], limits: GuardLimits) -> None:
        self._read, self._limits = read, limits
        self._number = 0
        self.newest: np.ndarray | None = None
        """The last good targets ()."""
        self.refused_in_a_row = self.refused = 0
        """Targets refused since the last good ones, and all together."""
        self.why = ""
        """Why the last refused ones were."""

    def take(self, q_measured: np.ndarray | None, now_s: float) -> bool:
        """Looks at the slot, with arguments as of `refusal`; True if there are good targets that are new."""
        targets = self._read()
        if targets is None or targets["number"] == self._number:
            return False
        self._number = int(targets["number"])
        why = refusal(targets, self.newest, q_measured, now_s, self._limits)
        if why:
            self.why, self.refused, self.refused_in_a_row = why, self.refused + 1, self.refused_in_a_row + 1
            return False
        self.newest, self.refused_in_a_row = targets, 0
        return True

    def age_s(self, now_s: float) -> float:
        """Of the last good targets, from their stamp [s]; infinite before the first."""
        return np.inf if self.newest is None else now_s - float(self.newest["stamp_s"])


_SAME = 1e-6


def _asked(targets: np.ndarray, q_measured: np.ndarray | None) -> np.ndarray:
    """What targets () ask of the servos at measured positions (29,) [rad], as a share of the torques, (29,)."""
    servo = 0.0 if q_measured is None else _KP * (targets["q"] - q_measured)
    return np.abs(targets["tau"] + servo) / LIMITS.torque


def _worst(values: np.ndarray) -> str:
    return g1.ALL_JOINTS[int(np.argmax(values))]
