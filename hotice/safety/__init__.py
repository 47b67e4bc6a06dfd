"""What judges whether a robot may go on: named faults, limits, ages, jumps, and the answer to each fault.

NumPy only: stations in Drake and a robot's guard ask the same functions. The modules `judge` and `jumps` hold plain
loops over numbers, which stations compile.
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
    from hotice.safety.responses import RESPONSES, answer_to
    from hotice.safety.watch import Decision, Watch
else:
    __getattr__, __dir__ = lazy_face(__name__)

__all__ = [
    "AgeLimits",
    "Answer",
    "CommandLimits",
    "DAMPING_KD",
    "Decision",
    "Fault",
    "JumpLimits",
    "LARGEST_SPEED",
    "MeasurementLimits",
    "PoseGate",
    "RESPONSES",
    "Watch",
    "answer_to",
]
