"""The constants under which a policy was trained and must be run, from its file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hotice.errors import CheckpointError
from hotice.model import g1
from hotice.task.contract import Contract
from hotice.task.history import LONGEST, is_length
from hotice.task.presets import PRESETS


@dataclass(frozen=True, kw_only=True)
class PolicyTask(Contract):
    """Constants of a trained policy; `object_field`: which field hands and object read, see `hotice.task.presets`."""

    object_field: str = "ogf"

    @classmethod
    def from_meta(cls, meta: Mapping[str, Any], name: str = "policy") -> PolicyTask:
        """From the description in a policy file. Raises `CheckpointError` naming what is missing or impossible."""
        preset, task = meta.get("preset"), meta.get("task")
        if not isinstance(preset, str) or preset not in PRESETS:
            raise CheckpointError(f"{name}: preset is {preset!r}: known are {', '.join(PRESETS)}")
        scan = task.get("scan", False) if isinstance(task, Mapping) else False
        if not isinstance(scan, bool):
            raise CheckpointError(f"{name}: task constant scan is {scan!r}: true or false is needed")
        past = task.get("history", 0) if isinstance(task, Mapping) else 0
        if not is_length(past):
            raise CheckpointError(
                f"{name}: task constant history is {past!r}: a whole number from 0 to {LONGEST} is needed"
            )
        values: dict[str, Any] = {"object_field": PRESETS[preset].object_field, "scan": scan, "history": past}
        for key in (f.name for f in fields(cls) if f.name not in values):
            value = task.get(key) if isinstance(task, Mapping) else None
            if isinstance(value, bool) or not isinstance(value, int | float) or not 0 <= value < np.inf:
                raise CheckpointError(
                    f"{name}: task constant {key} is {value!r}: a finite number of at least 0 is needed"
                )
            values[key] = value
        return cls(**values)

    @property
    def action_scale(self) -> NDArray[np.float64]:
        """Change of each joint target per unit action, (20,) [rad]."""
        scale = np.full(len(g1.ACTION_JOINTS), self.leg_scale_rad)
        scale[g1.UPPER] = self.arm_scale_rad
        return scale
