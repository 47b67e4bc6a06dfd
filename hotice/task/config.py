"""The task in numbers. Each default is marked with its source: paper, CAT (its public code), or ours."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from hotice import checks
from hotice.checks import Range
from hotice.errors import InvalidConfig
from hotice.model.dynamics import DynamicsConfig, student_dynamics
from hotice.model.object_range import ObjectRange
from hotice.task.contract import MOST, Contract
from hotice.task.rules import GOAL_M
from hotice.task.sensing import STUDENT_SENSING, SensingConfig

STUDENT_PUSH_M_S = 1.0
"""Largest push of students (CAT)."""


@dataclass(frozen=True, kw_only=True)
class TaskConfig(Contract):
    """Transport task: the contract of its policies, and all else. Lengths [m], times [s], angles [rad]."""

    episode_s: float = 5.0
    """Time limit of a trial (paper)."""
    goal_radius_m: float = GOAL_M
    """Arrival: root within this distance of the goal, horizontally."""
    swing_height_m: float = 0.10
    """Target height of a swinging sole at its peak (ours; CAT 0.07)."""
    objects: ObjectRange = field(default_factory=ObjectRange)
    """Carried objects (paper: at most 3.5 kg, 40 cm)."""
    carry_states: int = 64
    """Number of different objects in training, each with its grasp (ours)."""
    start_noise_m: float = 0.05
    """Uniform noise of the start position (ours)."""
    start_yaw_noise_rad: float = 0.15
    """Uniform noise of the start heading (ours)."""
    joint_noise_rad: float = 0.02
    """Uniform noise of the leg angles at the start (ours)."""
    anywhere: float = 0.0
    """Share of episodes that start anywhere with room to stand, heading along the field (training; ours)."""
    anywhere_yaw_noise_rad: float = 0.6
    """Uniform noise of the heading of such starts: goals lie in a sector of ± 35 degrees (ours)."""
    sensing: SensingConfig = field(default_factory=SensingConfig)
    """Noise and delay of what the actor reads (zero for teachers)."""
    dynamics: DynamicsConfig = field(default_factory=DynamicsConfig)
    """Spread of the robots' parameters (zero for teachers)."""
    push_m_s: float = 0.0
    """Largest push: a change of root velocity that all links take, not the object in the hands (CAT, student: 1.0; zero
    for teachers); the least is a tenth of it (CAT: 0.1)."""
    push_interval_s: float = 7.5
    """Mean time between pushes, which come at any control step with equal chance (CAT: 5 to 10)."""
    collisions: bool = True
    """Whether a collision of robot or object ends the episode."""
    tolerance_m: float = 0.0
    """Training curriculum: penetrations up to this deep are penalised but do not end the episode (ours)."""
    end_at_goal: bool = False
    """Whether reaching the goal ends the episode (evaluation)."""
    goal_stay_s: float = 0.0
    """Training: mean time at the goal before an episode is cut short, as by the time limit; 0: it never is (ours)."""

    def __post_init__(self) -> None:
        super().__post_init__()
        checks.numbers(
            self,
            Range(above=0, most=MOST),
            "episode_s",
            "goal_radius_m",
            "push_interval_s",
        )
        checks.numbers(
            self,
            Range(least=0, most=MOST),
            "swing_height_m",
            "start_noise_m",
            "start_yaw_noise_rad",
            "anywhere_yaw_noise_rad",
            "joint_noise_rad",
            "push_m_s",
            "tolerance_m",
            "goal_stay_s",
        )
        checks.wholes(self, Range(least=1, most=MOST), "carry_states")
        for name in ("collisions", "end_at_goal"):
            checks.flag(name, getattr(self, name))
        if self.max_steps < 1:
            raise InvalidConfig(
                f"episode_s is {self.episode_s!r}: at least a control step, {self.control_dt_s:g} s, is needed"
            )
        checks.number("anywhere", self.anywhere, checks.SHARE)

    @property
    def max_steps(self) -> int:
        """Control steps in an episode."""
        return round(self.episode_s / self.control_dt_s)

    def perturbed(self) -> TaskConfig:
        """The task under noise, delay, pushes, uncertain dynamics, as for students; for evaluation see `protocols`."""
        return replace(
            self, sensing=STUDENT_SENSING, dynamics=student_dynamics(self.physics_dt_s), push_m_s=STUDENT_PUSH_M_S
        )
