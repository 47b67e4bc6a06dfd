"""What judges whether a robot may go on: named faults, limits, ages, jumps, and the answer to each fault.

NumPy only. A station's safety monitor asks all of it, and compiles the loops of `judge`; a robot's guard shares limits,
jumps and how a fall is foreseen, and has a table of its own (`hotice.deploy.guard.faults`): what it measures, and whom
it tells, is more.
"""

from typing import TYPE_CHECKING

from hotice.lazy import lazy_face

if TYPE_CHECKING:
    from hotice.safety.faults import Answer, Fault
    from hotice.safety.jumps import PoseGate
    from hotice.safety.limits import (
        DAMPING_KD,
        LARGEST_SPEED,
        AgeLimits,
        CommandLimits,
        JumpLimits,
        MeasurementLimits,
    )
    from hotice.safety.responses import RESPONSES
else:
    __getattr__, __dir__ = lazy_face(__name__)

__all__ = [
    "AgeLimits",
    "Answer",
    "CommandLimits",
    "DAMPING_KD",
    "Fault",
    "JumpLimits",
    "LARGEST_SPEED",
    "MeasurementLimits",
    "PoseGate",
    "RESPONSES",
]
