"""Priority of guard and runner among other processes of the machine, and their memory, where the system allows it."""

from __future__ import annotations

import ctypes
import os
import sys
from pathlib import Path

PRIORITY, RUNNER_PRIORITY, SIMULATED_PRIORITY = 20, 10, 5
"""Of SCHED_FIFO, 1 to 99; above ordinary processes, below the kernel's own threads: guard, runner, simulated robot."""

_CURRENT, _FUTURE, _ON_FAULT = 1, 2, 4
"""Flags of `mlockall`: pages that are there, those to come, and none that was never touched."""
_CAP_IPC_LOCK = 1 << 14
MAY_WAIT_FOR_DISK = "not allowed to keep its memory (ulimit -l unlimited): a tick may wait for the disk"


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
    return _may_keep_memory() and ctypes.CDLL(None).mlockall(_CURRENT | _FUTURE | _ON_FAULT) == 0


def _may_keep_memory() -> bool:
    """Whether without a limit: one that is reached later would let any allocation fail, in the middle of a walk."""
    if sys.platform != "linux":
        return False
    import resource

    if resource.getrlimit(resource.RLIMIT_MEMLOCK)[0] == resource.RLIM_INFINITY:
        return True
    status = Path("/proc/self/status").read_text()
    held = next((line.split()[1] for line in status.splitlines() if line.startswith("CapEff:")), "0")
    return bool(int(held, 16) & _CAP_IPC_LOCK)
