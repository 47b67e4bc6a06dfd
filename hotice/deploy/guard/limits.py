"""Limits of the guard: each number of the fault table; what stations judge too comes from `hotice.safety`."""

from __future__ import annotations

import math
from dataclasses import dataclass

from hotice import checks
from hotice.errors import InvalidConfig
from hotice.safety.limits import FALLING_S, AgeLimits, CommandLimits, MeasurementLimits

_MEASURED, _COMMAND, _AGES = MeasurementLimits(), CommandLimits(), AgeLimits()


@dataclass(frozen=True, kw_only=True)
class GuardLimits:
    """When what happens; `docs/deploy.md` has the table. A value at its limit is not yet beyond. `InvalidConfig`."""

    state_warn_s: float = _AGES.state_s
    """Age of the state from which on it is told."""
    state_s: float = 0.050
    """Age of the state beyond which motors damp."""
    refused_states: int = 5
    """So many damaged or impossible states in a row count as silence."""
    target_repeat_s: float = _AGES.command_s
    """Age of the runner's targets from which on it is told; they are repeated."""
    target_posture_s: float = 0.060
    """Age of the targets beyond which the motors go back to the posture, at `step_rad` per 20 ms."""
    target_s: float = 0.080
    """Age of the targets beyond which motors damp: with a tick of the guard and its lateness, within 100 ms."""
    refused_targets: int = 3
    """So many refused targets in a row end in damping."""
    range_rad: float = _COMMAND.target_margin_rad
    """How far beyond a joint's range a target may be. What is sent stays within the range, the excess becomes a
    torque."""
    step_rad: float = _COMMAND.step_rad
    """Largest change of a target within 20 ms."""
    torque_share: float = 1.6
    """Largest torque that a target may ask of its servo, as a share of the joint's limit; in a good walk 1.22
    (measured). What is sent asks for at most 1."""
    lean_rad: float = _MEASURED.tilt_rad
    """Lean of the pelvis beyond which the robot falls, at most π."""
    falling_rad: float = _MEASURED.falling_rad
    """Lean that the pelvis will have 0.15 s ahead, at its present rate, beyond which it falls; at most π."""
    falling_s: float = FALLING_S
    """How long states must say so."""
    joint_rad_s: float = _MEASURED.joint_speed_rad_s
    """Measured joint speed beyond which it falls."""
    gyro_rad_s: float = _MEASURED.gyro_rad_s
    """Turning of the pelvis about any of its axes beyond which it falls."""
    jump_rad: float = 0.10
    """How much further than `joint_rad_s` allows an angle may be from the one before: else the state is refused."""
    winding_c: float = 110.0
    """Temperature of a winding [°C] beyond which the box is put down."""
    casing_c: float = 80.0
    """The same of a motor's casing [°C]."""
    battery_percent: float = 15.0
    """Charge below which the box is put down."""
    battery_start_percent: float = 20.0
    """Charge that a start needs."""
    lasting_s: float = 1.0
    """How long heat, charge or an error of a motor must last before it counts."""
    box_s: float = 2.0
    """Time since the box was last seen beyond which the robot stands still."""
    pose_s: float = 1.0
    """Age of the localization beyond which the robot stands still."""
    gamepad_s: float = 3.0
    """Time without gamepad beyond which the robot stands still."""
    alone_s: float = 0.5
    """How long nobody else may have sent commands before a start."""

    def __post_init__(self) -> None:
        for name in ("lean_rad", "falling_rad"):
            # no lean is beyond π: one in degrees would never act
            checks.number(name, getattr(self, name), checks.Range(above=0, most=math.pi, unit="rad"))
        whole = ("refused_states", "refused_targets")
        checks.numbers(self, checks.POSITIVE, but=whole)
        checks.wholes(self, checks.Range(least=1, most=1000), *whole)
        order = ("target_repeat_s", "target_posture_s", "target_s")
        for low, high in (("state_warn_s", "state_s"), order[:2], order[1:]):
            if getattr(self, low) > getattr(self, high):
                raise InvalidConfig(
                    f"{low} is {getattr(self, low):g}, {high} is {getattr(self, high):g}: {low} of at most {high} is "
                    f"needed"
                )
