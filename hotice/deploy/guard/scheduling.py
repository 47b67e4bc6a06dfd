"""Priority of guard and runner among other processes of the machine, and their memory, where the system allows it."""

from __future__ import annotations

import ctypes
import os
import sys

PRIORITY, RUNNER_PRIORITY, SIMULATED_PRIORITY = 20, 10, 5
"""Of SCHED_FIFO, 1 to 99; above ordinary processes, below the kernel's own threads: guard, runner, simulated robot."""

_CURRENT, _FUTURE, _ON_FAULT = 1, 2, 4
"""Flags of `mlockall`: pages that are there, those to come, and none that was never touched."""
MAY_WAIT_FOR_DISK = "not allowed to keep its memory (ulimit -l): a tick may wait for the disk"


def take_precedence(priority: int = PRIORITY) -> bool:
    """Lets this process run before all ordinary ones; False where the system does not allow it."""
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except PermissionError:
        return False
    return True


def give_way() -> None:
    """Undoes `take_precedence`."""
    os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


def stay_in_memory() -> bool:
    """Keeps all that this process touches in memory, its code too; False where the system does not allow it.

    Otherwise the system takes back pages of files that were not read for a while, and a tick that needs one again waits
    for the disk.
    """
    if sys.platform != "linux":
        return False
    return ctypes.CDLL(None, use_errno=True).mlockall(_CURRENT | _FUTURE | _ON_FAULT) == 0
