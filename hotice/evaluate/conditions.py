"""Under which conditions trials are simulated.

`Conditions` is the one place where physics step, friction cones and the spread of robots, noise, delays and pushes are
decided, for policies, the walking baseline and records alike.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from hotice.evaluate.referees import STAY_S
from hotice.task.config import TaskConfig
from hotice.task.contract import ROWS, STEP, UNITS
from hotice.task.moving import MovingConfig
from hotice.task.protocols import Protocol, get_protocol
from hotice.task.rules import GOAL_M

KEPT = (*STEP, *UNITS, *ROWS, "swing_height_m")
"""Fields that a policy's own task decides; of the physics step and its number only the control period remains."""


@dataclass(frozen=True, kw_only=True)
class Conditions:
    """Physics, perturbation and time limit of trials. Raises `UnknownName` for a source that is none."""

    protocol: str | Protocol = "robot"
    """Physics and perturbations: a name in `hotice.task.protocols`, or a protocol of one's own."""
    perturbed: bool = True
    """Whether the perturbations act."""
    without: tuple[str, ...] = ()
    """Sources of perturbation that are switched off."""
    horizon_s: float = 5.0
    """Time limit (paper: 5 s)."""
    moving: MovingConfig = MovingConfig()
    """What robots know of obstacles that move."""

    def __post_init__(self) -> None:
        get_protocol(self.protocol).task(TaskConfig(), without=self.without)

    @property
    def elliptic(self) -> bool:
        """Friction cones of the physics."""
        return get_protocol(self.protocol).elliptic

    @property
    def physics(self) -> str:
        """Physics in words, as reports have it."""
        return get_protocol(self.protocol).physics

    def task(self, trained: dict[str, Any]) -> TaskConfig:
        """The policy's training task as trials need it: from the scene's start, ended by fall or drop only.

        The time limit is longer than the trial's by `STAY_S`, see `hotice.evaluate.referees.afterwards`; `limit` has
        the trial's.
        """
        known = replace(TaskConfig(), **{k: trained[k] for k in KEPT if k in trained})
        known = get_protocol(self.protocol).task(known, perturbed=self.perturbed, without=self.without)
        task = replace(
            known,
            goal_radius_m=GOAL_M,
            anywhere=0.0,
            end_at_goal=False,
            collisions=False,
            tolerance_m=0.0,
            start_noise_m=0.03,
            start_yaw_noise_rad=0.1,
        )
        return replace(task, episode_s=self.horizon_s + STAY_S + 2 * task.control_dt_s)

    def limit(self, task: TaskConfig) -> int:
        """Control steps of a trial."""
        return max(1, round(self.horizon_s / task.control_dt_s))
