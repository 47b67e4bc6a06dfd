"""Rehearsal of a policy, or of the walking baseline in its place, before it takes over: how it is tried."""

from __future__ import annotations

from dataclasses import dataclass

from hotice import checks
from hotice.checks import Range


@dataclass(frozen=True, kw_only=True)
class RehearsalConfig:
    """Horizon and pushes of both trials."""

    horizon_s: float = 4.0
    """For how long; 0: not at all."""
    push_m_s: tuple[float, ...] = (0.0, 0.1, -0.1)
    """One try for each of these changes of the root's sideways velocity: a policy on the edge of its skill fails
    one."""

    def __post_init__(self) -> None:
        checks.number("horizon_s", self.horizon_s, Range(least=0, most=20, unit="s", note="0: no rehearsal"))
        object.__setattr__(self, "push_m_s", checks.vector("push_m_s", self.push_m_s, None))
