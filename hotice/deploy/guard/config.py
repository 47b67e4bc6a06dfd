"""Configuration of a guard."""

from __future__ import annotations

from dataclasses import dataclass, field

from hotice import checks
from hotice.deploy.guard.limits import GuardLimits


@dataclass(frozen=True, kw_only=True)
class GuardConfig:
    """Times, gains and needs of a guard. Raises `InvalidConfig`."""

    rate_hz: float = 500.0
    """Commands per second."""
    posture_s: float = 3.0
    """How long the way to the posture takes."""
    first_gain: float = 0.2
    """Share of the trained gains with which that way begins; it ends with all."""
    squeeze_s: float = 1.0
    """How long the arms keep their squeeze in damping, so that a box does not fall on the feet first."""
    waist_needed: bool = False
    """Whether a robot with a locked waist is refused."""
    gamepad_needed: bool = True
    """Whether a robot without gamepad may not start, nor walk on."""
    battery_needed: bool = True
    """Whether a robot that tells no charge may not start."""
    limits: GuardLimits = field(default_factory=GuardLimits)

    def __post_init__(self) -> None:
        checks.number("rate_hz", self.rate_hz, checks.Range(least=100, most=2000))
        checks.number("posture_s", self.posture_s, checks.Range(least=1, most=60))
        checks.number("first_gain", self.first_gain, checks.Range(least=0, most=1))
        checks.number("squeeze_s", self.squeeze_s, checks.Range(least=0, most=10))
        for name in ("waist_needed", "gamepad_needed", "battery_needed"):
            checks.flag(name, getattr(self, name))
