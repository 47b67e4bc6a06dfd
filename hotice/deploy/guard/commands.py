"""Commands of the guard: servos held to the joints' torques, damping, and the smooth way to a posture."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from hotice.deploy.command import DAMPING_KD, LIMITS, CheckedCommand
from hotice.deploy.messages.hg import ABSENT
from hotice.model import g1

JOINTS = len(g1.ALL_JOINTS)
_KP, _KD = (gain.astype(np.float32) for gain in g1.gains(g1.ALL_JOINTS))
ARMS = np.isin(g1.ALL_JOINTS, [*g1.ARM_JOINTS, *g1.WRIST_JOINTS])
"""(29,) which joints squeeze a box."""
_ZERO = np.zeros(JOINTS, np.float32)


@cache
def enabled_motors(machine: int) -> np.ndarray:
    """Which of the 29 motors this machine has, (29,) bool; none for one that is not commanded."""
    on = ~np.isin(np.arange(JOINTS), ABSENT.get(machine, tuple(range(JOINTS))))
    # a view of bytes, which a command need not copy
    return np.frombuffer(on.tobytes(), np.bool_)


def within_range(q: np.ndarray, tau: np.ndarray, gain: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """Targets [rad] within the joints' ranges, torques [N m] with what their excess asked of the servos.

    A policy presses an ankle by a target beyond its range; so its motors feel the same, within their torques.
    """
    inside = np.minimum(np.maximum(q, LIMITS.lower), LIMITS.upper)
    asked = tau + gain * _KP * (q - inside)
    return inside.astype(np.float32), _within_torques(asked).astype(np.float32)


def servo(
    q: np.ndarray, tau: np.ndarray, q_measured: np.ndarray, dq_measured: np.ndarray, machine: int, gain: float = 1.0
) -> CheckedCommand:
    """Servos at targets (29,) [rad] with torques (29,) [N m], `gain` times the trained gains, within all limits.

    Where the motor would be asked for more than its torque at what is measured, torque and gains shrink alike.
    """
    tau = _within_torques(tau)
    inside, ahead = within_range(q, tau, gain)
    # a joint at its stop is not pressed further
    at_stop = ((q > inside) & (q_measured >= LIMITS.upper)) | ((q < inside) & (q_measured <= LIMITS.lower))
    ahead = np.where(at_stop, tau.astype(np.float32), ahead)
    kp, kd = np.float32(gain) * _KP, np.float32(gain) * _KD
    share = _share(ahead + kp * (inside - q_measured) - kd * dq_measured)
    return CheckedCommand(
        q=inside, dq=_ZERO, tau=share * ahead, kp=share * kp, kd=share * kd, enabled=enabled_motors(machine)
    )


def within_torque(command: CheckedCommand, q_measured: np.ndarray, dq_measured: np.ndarray) -> CheckedCommand:
    """A command that is sent again at other positions (29,) [rad] and speeds (29,) [rad/s], shrunk as `servo` does."""
    share = _share(command.motor_torques(q_measured, dq_measured))
    return replace(command, tau=share * command.tau, kp=share * command.kp, kd=share * command.kd)


def _within_torques(tau: np.ndarray) -> np.ndarray:
    return np.minimum(np.maximum(tau, -LIMITS.torque), LIMITS.torque)


def _share(asked: np.ndarray) -> np.ndarray:
    """Share of torques (29,) [N m] that the motors have, at most 1."""
    return np.minimum(1.0, LIMITS.torque / np.maximum(np.abs(asked), 1e-6)).astype(np.float32)


def damping(machine: int, squeeze: CheckedCommand | None = None) -> CheckedCommand:
    """Every motor brakes, none holds; with `squeeze` the arms go on as in that command."""
    q, tau, kp, kd = (_ZERO.copy() for _ in range(4))
    kd += np.float32(DAMPING_KD)
    if squeeze is not None:
        for ours, theirs in zip((q, tau, kp, kd), (squeeze.q, squeeze.tau, squeeze.kp, squeeze.kd), strict=True):
            ours[ARMS] = theirs[ARMS]
    # a range need not hold zero
    return CheckedCommand(
        q=np.clip(q, LIMITS.lower, LIMITS.upper), dq=_ZERO, tau=tau, kp=kp, kd=kd, enabled=enabled_motors(machine)
    )


def smooth(share: float) -> float:
    """From 0 to 1 with zero speed and acceleration at both ends (quintic); 0 below 0 and 1 above 1."""
    s = min(max(share, 0.0), 1.0)
    return s * s * s * (10.0 - 15.0 * s + 6.0 * s * s)


def towards(q: np.ndarray, goal: np.ndarray, most: float) -> np.ndarray:
    """One step from q (29,) towards the goal, at most `most` [rad] for any joint."""
    return q + np.clip(goal - q, -most, most)
