"""Durations, forces and guards of a pick-up."""

from __future__ import annotations

from dataclasses import dataclass

from hotice import checks
from hotice.control.pick_plan import Durations

HEAVY_KG = 3.5


@dataclass(frozen=True, kw_only=True)
class PickupConfig:
    """Durations, forces and guards of a pick-up, all ours."""

    rate_hz: float = 200.0
    """Control rate."""
    settle_s: float = 0.5
    crouch_s: float = Durations.crouch_s
    reach_s: float = Durations.reach_s
    close_s: float = Durations.close_s
    touch_s: float = 1.5
    """Longest wait for both hands to feel the object."""
    squeeze_s: float = 1.0
    lift_s: float = Durations.lift_s
    retreat_s: float = Durations.retreat_s
    open_s: float = 1.0
    stand_s: float = 2.5
    squeeze_n: tuple[float, float] = (45.0, 60.0)
    """Normal force of each hand for an object without mass and for one of 3.5 kg."""
    touch_n: float = 4.0
    """A hand touches from this force on."""
    hold_n: float = 8.0
    """A hand that holds less for `lost_s` has lost the object."""
    lost_s: float = 0.2
    risen_share: float = 0.5
    """Share of the planned rise; less at the end of the lift is a missed grasp."""
    attempts: int = 3
    """Grasps before giving up."""

    def __post_init__(self) -> None:
        checks.numbers(self, checks.POSITIVE, but=("squeeze_n", "attempts"))
        checks.vector("squeeze_n", self.squeeze_n, 2, checks.POSITIVE)
        checks.whole("attempts", self.attempts, checks.COUNT)

    @property
    def durations(self) -> Durations:
        """Durations of the parts that are planned."""
        return Durations(
            crouch_s=self.crouch_s,
            reach_s=self.reach_s,
            close_s=self.close_s,
            lift_s=self.lift_s,
            retreat_s=self.retreat_s,
        )


def squeeze_of(squeeze_n: tuple[float, float], mass_kg: float) -> float:
    """Normal force of each hand [N] for an object of that mass; see `PickupConfig.squeeze_n`."""
    low, high = squeeze_n
    return low + (high - low) * min(mass_kg / HEAVY_KG, 1.0)
