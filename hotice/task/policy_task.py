"""The constants under which a policy was trained and must be run, from its file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

from hotice import checks
from hotice.errors import CheckpointError, InvalidConfig
from hotice.task.contract import Contract
from hotice.task.history import LENGTHS
from hotice.task.presets import PRESETS


@dataclass(frozen=True, kw_only=True)
class PolicyTask(Contract):
    """Constants of a trained policy; `object_field`: which field hands and object read, see `hotice.task.presets`."""

    object_field: str = "ogf"

    @classmethod
    def from_meta(cls, meta: Mapping[str, Any], name: str = "policy") -> PolicyTask:
        """From the description in a policy file. Raises `CheckpointError` naming what is missing or impossible."""
        preset, task = meta.get("preset"), meta.get("task")
        preset = checks.one_of(f"{name}: preset", preset, PRESETS, CheckpointError)
        task = task if isinstance(task, Mapping) else {}
        where = f"{name}: task constant"
        values: dict[str, Any] = {
            "object_field": PRESETS[preset].object_field,
            "scan": checks.flag(f"{where} scan", task.get("scan", False), CheckpointError),
            "history": checks.whole(f"{where} history", task.get("history", 0), LENGTHS, CheckpointError),
        }
        for key in (f.name for f in fields(cls) if f.name not in values):
            checks.number(f"{where} {key}", task.get(key), checks.NOT_NEGATIVE, CheckpointError)
            values[key] = task[key]
        try:
            return cls(**values)
        except InvalidConfig as error:
            raise CheckpointError(f"{where} {error}") from None
