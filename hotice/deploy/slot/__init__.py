"""Shared memory between guard and runner: the newest targets one way, the newest state and mode the other way.

NumPy and the standard library only. Linux: files in /dev/shm, locks of open files.
"""

from typing import TYPE_CHECKING

from hotice.lazy import lazy_face

if TYPE_CHECKING:
    from hotice.deploy.slot.slot import GuardSlot, RunnerSlot, SlotError
    from hotice.deploy.slot.watch import SlotWatch
else:
    __getattr__, __dir__ = lazy_face(__name__)

__all__ = ["GuardSlot", "RunnerSlot", "SlotError", "SlotWatch"]
