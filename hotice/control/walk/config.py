"""Numbers of the walking baseline."""

from __future__ import annotations

from dataclasses import dataclass

from hotice import checks
from hotice.checks import Range
from hotice.control.walk.swing import SwingShape


@dataclass(frozen=True, kw_only=True)
class TaskWeights:
    """Weights of the tasks of the whole-body QP, each of squared accelerations."""

    com: float = 500.0
    pelvis_height: float = 60.0
    tilt: float = 20.0
    yaw: float = 20.0
    foot: float = 60.0
    foot_turn: float = 10.0
    arms: float = 20.0
    legs: float = 0.002

    def __post_init__(self) -> None:
        checks.numbers(self, checks.POSITIVE)


@dataclass(frozen=True, kw_only=True)
class WalkConfig:
    """Gait, clearances and heights; every number is ours.

    Raises `InvalidConfig` for values that no gait has.
    """

    step_length_m: float = 0.27
    """Usual advance from one foothold to the next."""
    longest_step_m: float = 0.48
    """Largest advance, over a ground obstacle."""
    half_width_m: float = 0.1185
    """Feet to either side of the way; as they stand in a carry state."""
    swing_s: float = 0.39
    """Time of single support of a usual step."""
    foot_speed_m_s: float = 2.6
    """Fastest a foot travels; a step that would need more takes longer."""
    careful_speed_m_s: float = 1.9
    """The same over a ground obstacle: a leg that is swung fast turns the body."""
    lift_speed_m_s: float = 1.1
    """Fastest a foot rises or sinks."""
    double_support_s: float = 0.06
    """Time for which the load moves from one foot to the other."""
    shift_s: float = 0.36
    """Time for which the load moves onto the first stance foot."""
    swing_height_m: float = 0.06
    """Height of the sole at the top of a usual step."""
    swing_clearance_m: float = 0.02
    """Added to the height that passes over a ground obstacle."""
    ground_margin_m: float = 0.025
    """Distance of soles to ground obstacles."""
    body_margin_m: float = 0.10
    """Distance of body and load to other obstacles, where there is room."""
    head_margin_m: float = 0.05
    """Distance of head and load to what hangs over them."""
    pelvis_height_m: float = 0.71
    """Height of the pelvis while walking."""
    zmp_ahead_m: float = 0.035
    """Zero-moment point of a stance foot ahead of its ankle."""
    dcm_gain: float = 1.5
    """Feedback of the DCM error to the zero-moment point while both feet stand, beyond one."""
    settle_s: float = 0.4
    """Time for which the load moves to the middle after the last step."""
    freeze_s: float = 0.08
    """Before the landing, foothold and time stay as they are for this long."""
    hurry_s: float = 0.12
    """Most by which step adjustment may advance a landing."""
    wait_s: float = 0.12
    """Most by which it may delay one."""
    touch_n: float = 40.0
    """Force on a swing foot that counts as its landing [N]."""
    height_speed_m_s: float = 0.20
    """Fastest change of the pelvis height."""
    lean_speed_rad_s: float = 0.8
    """Fastest change of the lean."""
    weights: TaskWeights = TaskWeights()
    """Weights of the whole-body QP's tasks."""

    def __post_init__(self) -> None:
        checks.numbers(self, checks.POSITIVE, but=("weights",))
        longest = Range(least=self.step_length_m, most=0.6, note="step_length_m is the least")
        checks.number("longest_step_m", self.longest_step_m, longest)
        checks.number("pelvis_height_m", self.pelvis_height_m, Range(least=0.45, most=0.77))

    def swing_time(self, distance_m: float, shape: SwingShape) -> float:
        """Time of single support of a swing over `distance_m`: no peak speed of the foot is exceeded [s]."""
        peak = 1.875  # of a minimum-jerk motion over its mean speed
        fastest = self.foot_speed_m_s if shape.apex_m <= self.swing_height_m else self.careful_speed_m_s
        across = peak * distance_m / (shape.arrive - shape.leave) / fastest
        up = peak * shape.apex_m / min(shape.rise, 1.0 - shape.fall) / self.lift_speed_m_s
        return max(self.swing_s, across, up)
