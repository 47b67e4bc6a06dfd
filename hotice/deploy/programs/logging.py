"""Logs of the programs: opened so that their thread never keeps a loop waiting."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from typing import Any

import numpy as np

import hotice
from hotice.deploy.guard.loop import Lateness
from hotice.deploy.guard.scheduling import take_precedence
from hotice.deploy.log.writer import LogWriter
from hotice.deploy.programs.options import GuardOptions, RunnerOptions

SWITCH_S = 0.0005
"""Longest time for which the log's thread keeps the interpreter while the loop wants it [s]."""


def open_log(
    options: GuardOptions | RunnerOptions, name: str, kinds: Mapping[str, np.dtype | None], priority: int, **about: Any
) -> LogWriter:
    """A log in the options' folder; `about`: said beside options and version. Raises `OutputError`."""
    # a thread has the precedence of who made it: one without it, put aside with the interpreter in its hands, would
    # keep the loop waiting
    take_precedence(priority)
    sys.setswitchinterval(SWITCH_S)
    said = {"options": options.text(), "hotice": hotice.__version__, **about}
    return LogWriter(options.log, name, kinds, said, keep_s=options.keep_s)


def report(lateness: Lateness, log: LogWriter) -> dict[str, Any]:
    """What a program says of itself now and then."""
    return {
        "ticks": lateness.ticks,
        "skipped": lateness.skipped,
        "worst_late_ms": 1e3 * lateness.worst_late_s,
        "worst_took_ms": 1e3 * lateness.worst_took_s,
        "log": log.error or "",
        "log_dropped": log.dropped,
    }
