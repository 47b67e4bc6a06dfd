"""Rehearsal of a policy, or of the walking baseline in its place, before it takes over: how it is tried."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from hotice.errors import InvalidConfig


@dataclass(frozen=True, kw_only=True)
class RehearsalConfig:
    """How both are tried."""

    horizon_s: float = 4.0
    """For how long; 0: not at all."""
    push_m_s: tuple[float, ...] = (0.0, 0.1, -0.1)
    """One try for each of these changes of the root's sideways velocity: a policy on the edge of its skill fails
    one."""

    def __post_init__(self) -> None:
        (horizon,) = _numbers("horizon_s", [self.horizon_s])
        if not 0.0 <= horizon <= 20.0:
            raise InvalidConfig(f"horizon_s is {self.horizon_s!r}: 0 (no rehearsal) to 20 s are allowed")
        object.__setattr__(self, "push_m_s", _numbers("push_m_s", self.push_m_s))


def _numbers(name: str, value: Any) -> tuple[float, ...]:
    good = isinstance(value, Sequence) and not isinstance(value, str) and len(value) > 0
    if not good or not all(isinstance(v, int | float) and not isinstance(v, bool) and math.isfinite(v) for v in value):
        raise InvalidConfig(f"{name} is {value!r}: finite numbers are needed")
    return tuple(float(v) for v in value)
