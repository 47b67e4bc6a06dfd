"""Durations, forces and tolerances of a put-down."""

from __future__ import annotations

from dataclasses import dataclass

from hotice import checks
from hotice.control.pick_plan import Durations
from hotice.control.pickup import PickupConfig


@dataclass(frozen=True, kw_only=True)
class PutDownConfig:
    """Durations, forces and tolerances of a put-down, all ours."""

    rate_hz: float = PickupConfig.rate_hz
    """Control rate."""
    settle_s: float = 1.5
    """Time in which the body comes over the feet."""
    raise_s: float = Durations.retreat_s
    adjust_s: float = 1.0
    """Time in which the hands correct where the object is in them."""
    lower_s: float = 2.5
    sink_m_s: float = 0.02
    """Speed at which an object that should stand, but does not, is lowered further."""
    sink_m: float = 0.04
    """Longest way of that."""
    unload_s: float = 0.6
    """Time in which the support takes the weight."""
    let_go_s: float = 0.6
    """Time in which the hands stop pressing."""
    open_s: float = Durations.close_s
    withdraw_s: float = Durations.reach_s
    rise_s: float = Durations.crouch_s
    squeeze_n: tuple[float, float] = PickupConfig.squeeze_n
    """Normal force of each hand for an object without mass and for one of 3.5 kg, as it was picked up."""
    hold_n: float = PickupConfig.hold_n
    """A hand that holds less for `lost_s` has lost the object."""
    lost_s: float = PickupConfig.lost_s
    landed_m: float = 0.004
    """An object stands whose lowest point is this near to the top of the support."""
    shift_m: float = 0.06
    """Largest correction of where the object is in the hands."""
    foot_m: float = 0.015
    """Feet this far from where the plan has them step there."""
    foot_rad: float = 0.04
    """Feet turned by this much do too."""

    def __post_init__(self) -> None:
        checks.numbers(self, checks.POSITIVE, but=("squeeze_n",))
        checks.vector("squeeze_n", self.squeeze_n, 2, checks.POSITIVE)

    @property
    def durations(self) -> Durations:
        """Durations of the pick-up that is planned and run backwards."""
        return Durations(
            crouch_s=self.rise_s,
            reach_s=self.withdraw_s,
            close_s=self.open_s,
            lift_s=self.lower_s,
            retreat_s=self.raise_s,
        )
