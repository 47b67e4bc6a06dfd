"""The contract of a policy: numbers of the task that give its observations and actions their meaning.

`TaskConfig` has them beside all else, `PolicyTask` from a policy's file; teachers, evaluations and merges ask for
`UNITS`, `STEP` and `ROWS`, which are their names.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from hotice import checks
from hotice.checks import Range
from hotice.fields.defaults import MARGIN_M, RESOLUTION_M, SPEED_M_S, STOP_GAIN_HZ
from hotice.model import g1
from hotice.task.history import LENGTHS

MOST = 1_000_000
"""More of anything is a slip of the keyboard."""
SHORTEST_S = 1e-5
"""Shortest physics step."""


@dataclass(frozen=True, kw_only=True)
class Contract:
    """Constants that a policy is trained and run with. Lengths [m], times [s], angles [rad]."""

    physics_dt_s: float = 0.005
    """Physics step (ours)."""
    substeps: int = 4
    """Physics steps per control step: 50 Hz (paper)."""
    leg_scale_rad: float = 0.3
    """Joint target offset of the legs per unit action (ours)."""
    arm_scale_rad: float = 0.12
    """Joint target offset of the arms per unit action (ours)."""
    action_limit: float = 4.0
    """Actions are clipped to ± this (ours)."""
    speed_m_s: float = SPEED_M_S
    """Commanded speed (ours; the attractive force alone leaves too little time for 2 m in 5 s)."""
    stop_gain_hz: float = STOP_GAIN_HZ
    """Near the goal the commanded speed is this times the distance (ours)."""
    gait_hz: float = 1.4
    """Step clock (CAT: 1.3 to 1.5)."""
    resolution_m: float = RESOLUTION_M
    """Grid of the fields (CAT)."""
    margin_m: float = MARGIN_M
    """Inflation of the obstacles for the object-centric field (paper)."""
    scan: bool = False
    """Whether the actors also read the local obstacle scan, distances ahead of feet and body (ours; the paper: fields
    only)."""
    history: int = 0
    """Past control steps of which the actors also read joints, IMU and actions (ours)."""

    def __post_init__(self) -> None:
        checks.number("physics_dt_s", self.physics_dt_s, Range(least=SHORTEST_S, most=MOST))
        checks.wholes(self, Range(least=1, most=MOST), "substeps")
        checks.numbers(
            self,
            Range(above=0, most=MOST),
            "leg_scale_rad",
            "arm_scale_rad",
            "action_limit",
            "speed_m_s",
            "stop_gain_hz",
            "gait_hz",
            "resolution_m",
        )
        checks.number("margin_m", self.margin_m, Range(least=0, most=MOST))
        checks.flag("scan", self.scan)
        checks.whole("history", self.history, LENGTHS)

    @property
    def control_dt_s(self) -> float:
        """Time between actions."""
        return self.physics_dt_s * self.substeps

    @property
    def action_scale(self) -> NDArray[np.float64]:
        """Change of each joint target per unit action, (20,) [rad]."""
        scale = np.full(g1.ACTIONS, self.leg_scale_rad)
        scale[g1.UPPER] = self.arm_scale_rad
        return scale


STEP = ("physics_dt_s", "substeps")
"""Of these only the product, the control period, must stay: training and evaluation have physics of their own."""
ROWS = ("scan", "history")
"""These decide which rows there are to read: a policy may read fewer than its student does."""
UNITS = tuple(f.name for f in fields(Contract) if f.name not in (*STEP, *ROWS))
"""Fields that are never free: teacher and student, a policy and its scores, parts of a merge must share them."""
