"""What the motors are told in each mode."""

from __future__ import annotations

import numpy as np

from hotice.deploy.command import CheckedCommand
from hotice.deploy.guard.commands import JOINTS, damping, servo, smooth, towards, within_torque
from hotice.deploy.guard.config import GuardConfig
from hotice.deploy.guard.modes import SQUEEZING, Mode
from hotice.deploy.guard.targets import STEP_S, Targets

RETURN_NM = 1.0
"""Change of a torque in one tick on the way back to the posture [N m]."""


class Motion:
    """Remembers where the posture began and ends, the targets that are followed, and the last command."""

    def __init__(self, config: GuardConfig) -> None:
        self._config = config
        self._first = self.posture = self._followed = np.zeros(JOINTS)
        self._posture_tau = self._followed_tau = np.zeros(JOINTS)
        self._squeeze: CheckedCommand | None = None
        self.last: CheckedCommand | None = None
        """The last command that was made."""

    def enter(self, before: Mode, mode: Mode, q: np.ndarray, targets: Targets) -> None:
        """Begins a mode at measured positions q (29,) [rad]."""
        if mode is Mode.DAMPING:
            self._squeeze = self.last if before in SQUEEZING else None
        if mode is Mode.POSTURE and targets.newest is not None:
            self._first = q.astype(float)
            self.posture, self._posture_tau = targets.newest["q"], targets.newest["tau"]
        if before is Mode.READY:
            self._followed, self._followed_tau = self.posture, self._posture_tau

    def command(
        self, mode: Mode, machine: int, q: np.ndarray, dq: np.ndarray, targets: Targets, *, since_s: float, now_s: float
    ) -> CheckedCommand:
        """The command of a mode other than OFF.

        Args:
            mode, machine: see there
            q, dq: (29,) measured [rad], [rad/s]
            targets: of the runner
            since_s: how long the mode has lasted [s]; now_s: on the clock of the targets' stamps [s]
        """
        if mode is Mode.DAMPING:
            squeeze = self._squeeze if since_s < self._config.squeeze_s else None
            made = damping(machine, None if squeeze is None else within_torque(squeeze, q, dq))
        elif mode is Mode.POSTURE:
            share = smooth(since_s / self._config.posture_s)
            gain = self._config.first_gain + (1.0 - self._config.first_gain) * share
            way = self._first + share * (self.posture - self._first)
            made = servo(way, share * self._posture_tau, q, dq, machine, gain)
        elif mode is Mode.READY:
            made = servo(self.posture, self._posture_tau, q, dq, machine)
        else:
            self._follow(targets, now_s)
            made = servo(self._followed, self._followed_tau, q, dq, machine)
        self.last = made
        return made

    def _follow(self, targets: Targets, now_s: float) -> None:
        limits = self._config.limits
        if targets.newest is not None and targets.age_s(now_s) <= limits.target_posture_s:
            self._followed, self._followed_tau = targets.newest["q"], targets.newest["tau"]
            return
        most = limits.step_rad / STEP_S / self._config.rate_hz
        self._followed = towards(self._followed, self.posture, most)
        self._followed_tau = towards(self._followed_tau, self._posture_tau, RETURN_NM)
