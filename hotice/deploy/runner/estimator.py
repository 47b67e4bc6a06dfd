"""Protocol of an estimator: from a LowState, and sources of its own, to a percept and the ages of what is in it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from hotice.policy.percept import Percept


@dataclass(frozen=True, kw_only=True, eq=False)
class Estimate:
    """What is believed now."""

    percept: Percept
    """What the policy reads."""
    pose_age_s: float
    """Since localization was last believed [s]."""
    box_age_s: float
    """Since the object was last seen and believed [s]."""
    disputed: bool = False
    """Whether localization and what was believed before disagree for good: an operator has to look."""
    pose_verdict: str = "ok"
    """Of the newest pose of localization: "ok", or why it is not believed."""
    box_verdict: str = "ok"
    """Of the newest look at the object."""


class Estimator(Protocol):
    """Takes every state that the runner reads."""

    def update(self, state: np.ndarray, now_s: float, state_s: float | None = None) -> Estimate | None:
        """The estimate with a LowState () read at `now_s` [s]; None until pelvis and object were seen once.

        `state_s`: when the state came to who read it first [s]; by default now.
        """
        ...

    def acknowledge(self) -> None:
        """An operator knows of a dispute, which is told no more; what is believed stays."""
        ...

    def settle(self) -> None:
        """Ends a dispute: an operator has looked and goes on, and the newest localization counts."""
        ...
