"""The constants under which a policy was trained and must be run, from its file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hotice import checks
from hotice.errors import CheckpointError
from hotice.model import g1
from hotice.task.history import LENGTHS

OBJECT_FIELDS = {"dual_hodpf": "ogf", "single_hodpf": "ogf", "dual_sgf": "sgf", "single_sgf": "sgf"}
"""Which field hands and object read, by preset (`hotice.task.config.PRESETS`)."""


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
        preset = checks.one_of(f"{name}: preset", preset, OBJECT_FIELDS, CheckpointError)
        task = task if isinstance(task, Mapping) else {}
        where = f"{name}: task constant"
        values: dict[str, Any] = {
            "object_field": OBJECT_FIELDS[preset],
            "scan": checks.flag(f"{where} scan", task.get("scan", False), CheckpointError),
            "history": checks.whole(f"{where} history", task.get("history", 0), LENGTHS, CheckpointError),
        }
        for key in (f.name for f in fields(cls) if f.name not in values):
            checks.number(f"{where} {key}", task.get(key), checks.NOT_NEGATIVE, CheckpointError)
            values[key] = task[key]
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
