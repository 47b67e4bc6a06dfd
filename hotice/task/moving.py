"""What a robot knows of obstacles that move, in numbers."""

from __future__ import annotations

from dataclasses import dataclass

from hotice import checks
from hotice.checks import Range
from hotice.errors import InvalidConfig

KNOWN = ("still", "near", "live")
"""What fields and scan know of what moves: nothing; how near it is; and which ways it leaves open."""
RATE = Range(above=0, most=1000, unit="Hz")


@dataclass(frozen=True, kw_only=True)
class MovingConfig:
    """Sight of moving obstacles. Scenes without any are as they always were."""

    known: str = "near"
    """`still`: fields of what stands still, as if nothing moved. `near`: distances, repulsion and scan see movers
    exactly where they are known to be; ways to the goal are those of what stands still. `live`: these too are those of
    the moment, `ways_hz` times a second."""
    sensor_hz: float = 10.0
    """How often a robot sees movers; between, they are taken to go on with the velocity of their last two places."""
    sensor_delay_s: float = 0.1
    """How old that is when it comes."""
    ways_hz: float = 5.0
    """Rate at which the geodesic distance is that of the moment, for `live`."""

    def __post_init__(self) -> None:
        checks.one_of("known", self.known, KNOWN, InvalidConfig)
        checks.number("sensor_hz", self.sensor_hz, RATE)
        checks.number("sensor_delay_s", self.sensor_delay_s, Range(least=0, most=1, unit="s"))
        checks.number("ways_hz", self.ways_hz, Range(above=0, most=50, unit="Hz"))
