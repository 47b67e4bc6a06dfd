"""Refusing early what cannot fit into memory."""

from __future__ import annotations

from pathlib import Path

from hotice.errors import InvalidConfig

BYTES_PER_ENV = 700_000
"""A persistent simulation of robot and object, with its tensors (measured: 0.45 to 0.65 MB)."""
BYTES_PER_TRIAL = 200


def available_bytes() -> int:
    """Memory that can still be had, as the kernel estimates it; a large number where it does not say."""
    try:
        lines = Path("/proc/meminfo").read_text().splitlines()
        return next(int(line.split()[1]) * 1024 for line in lines if line.startswith("MemAvailable"))
    except (OSError, StopIteration, ValueError, IndexError):
        return 1 << 62


def check_memory(num_envs: int, trials: int = 0) -> None:
    """Raises `InvalidConfig` when so many simulations and trials need more than the memory that is available."""
    need, have = num_envs * BYTES_PER_ENV + trials * BYTES_PER_TRIAL, available_bytes()
    if need > 0.9 * have:
        raise InvalidConfig(
            f"{num_envs:,} simulations at once and {trials:,} trials need about {need / 2**30:.1f} GiB of memory, "
            f"{have / 2**30:.1f} GiB are available: ask for fewer"
        )
