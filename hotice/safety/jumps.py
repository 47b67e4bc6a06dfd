"""Poses that jump: refused, until so many in a row agree that they must be the truth."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from hotice.safety.limits import JumpLimits

Array = NDArray[np.float64]
POSE = 12
"""Numbers of a pose: position [m], rotation matrix row by row."""
GATE = 2 * POSE + 1
"""Numbers of a gate: the accepted pose, the newest refused one, how many of these agree; NaN: none yet."""


def empty_gate() -> Array:
    """A gate that has seen nothing: the first pose is accepted."""
    return np.append(np.full(2 * POSE, np.nan), 0.0)


def near(a: Array, b: Array, limits: JumpLimits) -> bool:
    """Whether two poses (12,) are within the limits of each other; not if one holds NaN."""
    apart = math.dist(a[:3], b[:3])
    cosine = 0.5 * (float(a[3:] @ b[3:]) - 1.0)
    return apart <= limits.distance_m and cosine >= math.cos(limits.angle_rad)


def pass_gate(gate: Array, pose: Array, limits: JumpLimits) -> bool:
    """Whether a finite pose (12,) is accepted; keeps in `gate` (25,) what it has to remember."""
    known, refused = gate[:POSE], gate[POSE:-1]
    if math.isnan(known[0]) or near(known, pose, limits):
        accepted = True
    else:
        gate[-1] = gate[-1] + 1 if near(refused, pose, limits) else 1
        accepted = bool(gate[-1] >= limits.agreeing)
    refused[:] = np.nan if accepted else pose
    if accepted:
        known[:], gate[-1] = pose, 0.0
    return accepted


class PoseGate:
    """`pass_gate` with a memory of its own.

    Args:
        limits: how far is too far.
    """

    def __init__(self, limits: JumpLimits) -> None:
        self.limits, self.state = limits, empty_gate()

    def accepts(self, position: Array, rotation: Array) -> bool:
        """Whether a pose, (3,) [m] and (3, 3), is accepted."""
        return pass_gate(self.state, np.concatenate([position, np.ravel(rotation)]), self.limits)

    def track(self, position: Array, rotation: Array) -> None:
        """Moves the accepted pose on to where tracking has it now."""
        self.state[:POSE] = np.concatenate([position, np.ravel(rotation)])
