"""The constants under which a policy was trained and must be run, from its file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hotice.errors import CheckpointError
from hotice.model import g1
from hotice.task.history import LONGEST, is_length

OBJECT_FIELDS = {"dual_hodpf": "ogf", "single_hodpf": "ogf", "dual_sgf": "sgf", "single_sgf": "sgf"}
"""Which field hands and object read, by preset (`hotice.task.presets.PRESETS`)."""


@dataclass(frozen=True, kw_only=True)
class PolicyTask:
    """Constants of a trained policy; see `hotice.sim.TaskConfig`, which describes each."""

    physics_dt_s: float = 0.005
    substeps: int = 4
    leg_scale_rad: float = 0.3
    arm_scale_rad: float = 0.12
    action_limit: float = 4.0
    speed_m_s: float = 0.7
    stop_gain_hz: float = 3.0
    gait_hz: float = 1.4
    resolution_m: float = 0.04
    margin_m: float = 0.08
    object_field: str = "ogf"
    scan: bool = False
    history: int = 0

    @classmethod
    def from_meta(cls, meta: Mapping[str, Any], name: str = "policy") -> PolicyTask:
        """From the description in a policy file. Raises `CheckpointError` naming what is missing or impossible."""
        preset, task = meta.get("preset"), meta.get("task")
        if preset not in OBJECT_FIELDS:
            raise CheckpointError(f"{name}: preset is {preset!r}: known are {', '.join(OBJECT_FIELDS)}")
        scan = task.get("scan", False) if isinstance(task, Mapping) else False
        if not isinstance(scan, bool):
            raise CheckpointError(f"{name}: task constant scan is {scan!r}: true or false is needed")
        past = task.get("history", 0) if isinstance(task, Mapping) else 0
        if not is_length(past):
            raise CheckpointError(
                f"{name}: task constant history is {past!r}: a whole number from 0 to {LONGEST} is needed"
            )
        values: dict[str, Any] = {"object_field": OBJECT_FIELDS[preset], "scan": scan, "history": past}
        for key in (f.name for f in fields(cls) if f.name not in values):
            value = task.get(key) if isinstance(task, Mapping) else None
            if isinstance(value, bool) or not isinstance(value, int | float) or not 0 <= value < np.inf:
                raise CheckpointError(
                    f"{name}: task constant {key} is {value!r}: a finite number of at least 0 is needed"
                )
            values[key] = value
        return cls(**values)

    @property
    def control_dt_s(self) -> float:
        """Time between actions [s]."""
        return self.physics_dt_s * self.substeps

    @property
    def action_scale(self) -> NDArray[np.float64]:
        """Change of each joint target per unit action, (20,) [rad]."""
        scale = np.full(len(g1.ACTION_JOINTS), self.leg_scale_rad)
        scale[g1.UPPER] = self.arm_scale_rad
        return scale
