"""Limits of measurements, commands, ages and jumps. Defaults are those of a robot; stations have their own."""

from __future__ import annotations

import math
from dataclasses import dataclass

from hotice import checks
from hotice.task.rules import FALLEN_M

DAMPING_KD = 8.0
"""Damping of a falling robot's joints [N m s/rad] (docs/station.md)."""
FALLING_S = 0.02
"""How long a robot must be seen falling over: two measurements of a station (docs/station.md)."""
AHEAD_S = 0.15
"""How far ahead its lean is looked at, at the present rate (docs/station.md)."""
LARGEST_SPEED = 20.0
"""Largest joint speed that is commanded [rad/s]."""


@dataclass(frozen=True, kw_only=True)
class MeasurementLimits:
    """Limits of one measurement."""

    quaternion_tolerance: float = 0.1
    """How far a quaternion's, or a rotation's column's, length may be from 1."""
    joint_speed_rad_s: float = 30.0
    """Beyond it a robot falls (ours; good walks of `student` under pushes of 0.5 m/s reach 23.9 at a knee)."""
    possible_speed_rad_s: float = 100.0
    """Beyond it the measurement is wrong: no G1 joint turns so fast (ours)."""
    gyro_rad_s: float = 6.0
    """Largest turning rate of the pelvis, of each axis (unitree_sdk2)."""
    tilt_rad: float = 1.0
    """Largest lean of the pelvis, at most π (unitree_sdk2)."""
    falling_rad: float = 0.9
    """Largest lean that the pelvis will have 0.15 s ahead at its present rate, at most π (ours; docs/station.md)."""
    joint_margin_rad: float = 0.1
    """How far a joint may be pressed beyond its range (ours)."""
    possible_margin_rad: float = 0.6
    """Further beyond its range the measurement is wrong (ours)."""
    lowest_pelvis_m: float = FALLEN_M
    """Lower is a fall, as in the task; under the floor is no place at all."""
    highest_pelvis_m: float = 1.5
    """Higher is a wrong measurement (ours)."""
    box_reach_m: float = 1.0
    """Largest distance of a carried object's centre from the pelvis (ours)."""

    def __post_init__(self) -> None:
        # it acts by its cosine, which an angle beyond π would turn round
        for name in ("tilt_rad", "falling_rad"):
            checks.number(name, getattr(self, name), checks.Range(least=0, most=math.pi, unit="rad"))
        checks.numbers(self, checks.NOT_NEGATIVE, "joint_margin_rad", "possible_margin_rad", "lowest_pelvis_m")
        checks.numbers(
            self,
            checks.POSITIVE,
            "quaternion_tolerance",
            "joint_speed_rad_s",
            "possible_speed_rad_s",
            "gyro_rad_s",
            "highest_pelvis_m",
            "box_reach_m",
        )


@dataclass(frozen=True, kw_only=True)
class CommandLimits:
    """Limits of a command."""

    target_margin_rad: float = 1.2
    """How far a target may be beyond its joint's range (ours; good walks of `student` press ankles with targets 0.9
    beyond: 95 % of their steps have one that is)."""
    step_rad: float = 0.7
    """Largest change of a target from one to the next, 20 ms later (ours; in good walks 0.47)."""
    torque_share: float = 1.0
    """Largest torque as a share of the motor's limit."""

    def __post_init__(self) -> None:
        checks.numbers(self, checks.NOT_NEGATIVE, "target_margin_rad")
        checks.numbers(self, checks.POSITIVE, "step_rad", "torque_share")


@dataclass(frozen=True, kw_only=True)
class AgeLimits:
    """Ages from which something is late; `hotice.safety.RESPONSES` says what follows."""

    state_s: float = 0.02
    """States come at 500 Hz (ours)."""
    command_s: float = 0.04
    """Commands come at 50 Hz (ours)."""
    pose_s: float = 0.3
    """Poses of the pelvis come at 10 Hz and are tracked in between."""
    box_s: float = 0.1
    """Poses of the object come at 30 Hz and more."""

    def __post_init__(self) -> None:
        checks.numbers(self, checks.POSITIVE)


@dataclass(frozen=True, kw_only=True)
class JumpLimits:
    """When a pose is refused for being too far from the known one, and when it is believed all the same."""

    distance_m: float
    """From the known pose, at most."""
    angle_rad: float
    """Turned against the known pose, at most."""
    agreeing: int = 5
    """So many refused poses in a row, each near the one before, are the truth."""

    def __post_init__(self) -> None:
        checks.numbers(self, checks.POSITIVE, "distance_m", "angle_rad")
        checks.wholes(self, checks.COUNT, "agreeing")


BOX_JUMP = JumpLimits(distance_m=0.10, angle_rad=math.radians(20.0))
"""Of a carried object in the pelvis frame, from frame to frame (ours)."""
POSE_JUMP = JumpLimits(distance_m=0.15, angle_rad=math.radians(10.0))
"""Of the pelvis, against tracking (ours)."""
