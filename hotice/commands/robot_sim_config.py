"""Options of `hotice robot-sim`."""

from __future__ import annotations

from dataclasses import dataclass

from hotice import checks
from hotice.checks import Range
from hotice.deploy.dds.node import LARGEST_DOMAIN, LOOPBACK
from hotice.deploy.simulated.config import SimulatedRobotConfig
from hotice.deploy.sources.udp import MOVERS_PORT, POSE_PORT, TAGS_PORT
from hotice.errors import InvalidConfig

ROBOT_DOMAIN = 0
PORT = Range(least=1, most=65535)


@dataclass(frozen=True, kw_only=True)
class RobotSimConfig(SimulatedRobotConfig):
    """One simulated robot on a network."""

    domain: int = 1
    """DDS domain; 0 is a real robot's, and allowed on loopback alone. One domain for each simulated robot."""
    interface: str = "lo"
    """Network interface; "lo" is this machine alone."""
    duration_s: float | None = None
    """Ends after so long [s]; without it by Ctrl-C."""
    pose_port: int = POSE_PORT
    """UDP port on this machine to which localization is sent."""
    tags_port: int = TAGS_PORT
    """UDP port on this machine to which corners of tags are sent."""
    movers_port: int = MOVERS_PORT
    """UDP port on this machine to which poses of obstacles that move are sent, for scenes that have some."""

    def __post_init__(self) -> None:
        super().__post_init__()
        checks.whole("domain", self.domain, Range(least=0, most=LARGEST_DOMAIN))
        if self.domain == ROBOT_DOMAIN and self.interface != LOOPBACK:
            raise InvalidConfig(
                f"domain is {ROBOT_DOMAIN}, a real robot's, on interface {self.interface!r}: a simulated robot there "
                f"would be taken for it; use another domain, or interface {LOOPBACK!r}"
            )
        if self.duration_s is not None:
            checks.number("duration_s", self.duration_s, checks.POSITIVE)
        checks.whole("pose_port", self.pose_port, PORT)
        checks.whole("tags_port", self.tags_port, PORT)
        checks.whole("movers_port", self.movers_port, PORT)
