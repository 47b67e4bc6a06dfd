"""Poses that jump: refused, until so many in a row agree that they must be the truth."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hotice.safety.limits import BOX_JUMP, POSE_JUMP, JumpLimits
from hotice.task.sensing import SensingConfig

Array = NDArray[np.float64]
POSE = 12
"""Numbers of a pose: position [m], rotation matrix row by row."""
GATE = 2 * POSE + 1
"""Numbers of a gate: the accepted pose, the newest refused one, how many of these agree; NaN: none yet."""
REFUSED, NEAR, AGREED = range(3)
"""What a gate says of a pose: too far; near the accepted one, or the first; far, but so many agree that it is true."""
WALKS_M_S, TURNS_RAD_S = 1.0, 2.0
"""As fast walks and turns a robot that does not fall (ours)."""


def empty_gate() -> Array:
    """A gate that has seen nothing: the first pose is accepted."""
    return np.append(np.full(2 * POSE, np.nan), 0.0)


def jump_array(limits: JumpLimits) -> Array:
    """Limits as `pass_gate` reads them: distance [m], cosine of the angle, how many have to agree."""
    return np.array([limits.distance_m, math.cos(limits.angle_rad), float(limits.agreeing)])


def pass_gate(gate, pose, limits):
    """Judgement of a finite pose (12,): `REFUSED`, `NEAR` or `AGREED`; keeps in `gate` (25,) what it has to remember.

    A plain loop, which stations compile. `limits` (3,): see `jump_array`.
    """
    close = 0
    for known in range(2):
        off2, trace = 0.0, 0.0
        for i in range(3):
            off = gate[12 * known + i] - pose[i]
            off2 += off * off
        for i in range(3, 12):
            trace += gate[12 * known + i] * pose[i]
        # not if one holds NaN
        if math.sqrt(off2) <= limits[0] and 0.5 * (trace - 1.0) >= limits[1]:
            close += 1 + known
    said = 0
    if math.isnan(gate[0]) or close % 2 == 1:
        said = 1
    else:
        gate[24] = gate[24] + 1.0 if close >= 2 else 1.0
        if gate[24] >= limits[2]:
            said = 2
    for i in range(12):
        gate[12 + i] = math.nan if said else pose[i]
        if said:
            gate[i] = pose[i]
    if said:
        gate[24] = 0.0
    return said


class PoseGate:
    """`pass_gate` with a memory of its own.

    Args:
        limits: how far is too far.
    """

    def __init__(self, limits: JumpLimits) -> None:
        self.limits, self.state = jump_array(limits), empty_gate()

    def judge(self, position: Array, rotation: Array) -> int:
        """`REFUSED`, `NEAR` or `AGREED`: a pose, (3,) [m] and (3, 3)."""
        return pass_gate(self.state, np.concatenate([position, np.ravel(rotation)]), self.limits)

    def accepts(self, position: Array, rotation: Array) -> bool:
        """Whether a pose, (3,) [m] and (3, 3), is accepted."""
        return self.judge(position, rotation) != REFUSED

    def track(self, position: Array, rotation: Array) -> None:
        """Moves the accepted pose on to where tracking has it now."""
        self.state[:POSE] = np.concatenate([position, np.ravel(rotation)])


def jump_limits(sensing: SensingConfig) -> tuple[JumpLimits, JumpLimits]:
    """Jumps of pelvis and object between two percepts of these sensors, whose noise is none."""
    # half widths of three axes, of the one pose and of the other
    noise = 2.0 * math.sqrt(3.0)
    held_s = 0.0 if sensing.root_tracking or not sensing.root_hz else 1.0 / sensing.root_hz
    # of the first two poses the filter takes the mean
    share = 0.5 if sensing.object_filter_s else 1.0
    place = _wider(
        POSE_JUMP,
        noise * sensing.root_pos_m + held_s * WALKS_M_S,
        2.0 * sensing.root_yaw_rad + held_s * TURNS_RAD_S,
    )
    return place, _wider(BOX_JUMP, noise * share * sensing.object_pos_m, noise * share * sensing.object_rot_rad)


def _wider(limits: JumpLimits, distance_m: float, angle_rad: float) -> JumpLimits:
    # it acts by its cosine, which an angle beyond π would turn round
    angle_rad = min(math.pi, limits.angle_rad + angle_rad)
    return replace(limits, distance_m=limits.distance_m + distance_m, angle_rad=angle_rad)
