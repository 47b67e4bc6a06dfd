"""The guard: sends every command of the robot, 500 times a second, and ends in damping whatever else fails.

It needs NumPy and a link alone: no simulator, no network beside the robot's, no compiler.
"""

from typing import TYPE_CHECKING

from hotice.lazy import lazy_face

if TYPE_CHECKING:
    from hotice.deploy.guard.config import GuardConfig
    from hotice.deploy.guard.dry import DryLink
    from hotice.deploy.guard.faults import Cause, Finding, Reaction
    from hotice.deploy.guard.guard import Event, Guard
    from hotice.deploy.guard.keyboard import Keyboard
    from hotice.deploy.guard.limits import GuardLimits
    from hotice.deploy.guard.loop import Lateness, run_loop
    from hotice.deploy.guard.modes import Mode, Request
    from hotice.deploy.guard.process import run_guard
else:
    __getattr__, __dir__ = lazy_face(__name__)

__all__ = [
    "Cause",
    "DryLink",
    "Event",
    "Finding",
    "Guard",
    "GuardConfig",
    "GuardLimits",
    "Keyboard",
    "Lateness",
    "Mode",
    "Reaction",
    "Request",
    "run_guard",
    "run_loop",
]
