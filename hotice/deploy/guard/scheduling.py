"""Priority of guard and runner among other processes of the machine, where the system allows it."""

from __future__ import annotations

import os

PRIORITY, RUNNER_PRIORITY, SIMULATED_PRIORITY = 20, 10, 5
"""Of SCHED_FIFO, 1 to 99; above ordinary processes, below the kernel's own threads: guard, runner, simulated robot."""


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
