"""Deployment of a student: messages and links of a Unitree G1. Importing it needs NumPy only; DDS: the extra `deploy`.

Nothing here was ever run on a robot: docs/deploy.md says what that leaves open.
"""

from typing import TYPE_CHECKING

from hotice.lazy import lazy_face

if TYPE_CHECKING:
    from hotice.deploy.clock import Clock, MonotonicClock, SimulatedClock
    from hotice.deploy.command import LIMITS, CheckedCommand, UnsafeCommand
    from hotice.deploy.link.faults import Faults
    from hotice.deploy.link.memory import MemoryBus
    from hotice.deploy.link.protocol import Link, LinkError, RobotEnd
    from hotice.deploy.link.publishers import SecondPublisher, check_sole_publisher
    from hotice.deploy.switcher import active_controller, leave_high_level
else:
    __getattr__, __dir__ = lazy_face(__name__)

__all__ = [
    "CheckedCommand",
    "Clock",
    "Faults",
    "LIMITS",
    "Link",
    "LinkError",
    "MemoryBus",
    "MonotonicClock",
    "RobotEnd",
    "SecondPublisher",
    "SimulatedClock",
    "UnsafeCommand",
    "active_controller",
    "check_sole_publisher",
    "leave_high_level",
]
