"""Cores that this process may use, which can be fewer than the machine has: affinity and control groups."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator
from pathlib import Path

ROOT = Path("/")


def usable_cores(root: Path = ROOT) -> int:
    """Number of cores that this process may keep busy, at least 1.

    The smallest of: the cores of its affinity (`taskset`, cpusets, Slurm), and the CPU time that the control groups of
    version 1 or 2 that it is in allow (containers, systemd, Kubernetes), where a part of a core counts as one. `root`:
    where `proc` and `sys` are. A file that is missing or says something else limits nothing.
    """
    affinity = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return max(1, min([affinity, *(math.ceil(quota) for quota in _quotas(root))]))


def _quotas(root: Path) -> Iterator[float]:
    """Limits in cores, of each group that the process is in and of the groups around it."""
    for number, controllers, group in _groups(root):
        if number == "0" and not controllers:
            yield from _limits(root / "sys/fs/cgroup", group, _limit_v2)
        elif "cpu" in controllers.split(","):
            # the folder is named by all controllers of the hierarchy, and linked by each alone
            for name in dict.fromkeys((controllers, "cpu")):
                yield from _limits(root / "sys/fs/cgroup" / name, group, _limit_v1)


def _groups(root: Path) -> Iterator[tuple[str, str, str]]:
    """Lines `number:controllers:/group` of `/proc/self/cgroup`."""
    for line in _read(root / "proc/self/cgroup").splitlines():
        parts = line.split(":", 2)
        if len(parts) == 3:
            yield parts[0], parts[1], parts[2].strip("/")


def _limits(mount: Path, group: str, limit: Callable[[Path], float | None]) -> Iterator[float]:
    """Limits of a group and of those above it; in a container the group's own path may not be there."""
    steps = [step for step in group.split("/") if step not in ("", ".", "..")]
    for depth in range(len(steps), -1, -1):
        found = limit(mount.joinpath(*steps[:depth]))
        if found is not None:
            yield found


def _limit_v2(folder: Path) -> float | None:
    """Cores of `cpu.max`, "QUOTA PERIOD" or "max PERIOD" in µs."""
    return _ratio(*(_read(folder / "cpu.max").split() + ["", ""])[:2])


def _limit_v1(folder: Path) -> float | None:
    """Cores of the quota in µs, -1 for none, and its period."""
    return _ratio(_read(folder / "cpu.cfs_quota_us"), _read(folder / "cpu.cfs_period_us"))


def _ratio(quota: str, period: str) -> float | None:
    try:
        used, of = int(quota), int(period)
    except ValueError:
        return None
    return used / of if used > 0 and of > 0 else None


def _read(path: Path) -> str:
    try:
        return path.read_text().strip()
    except (OSError, UnicodeDecodeError):
        return ""
