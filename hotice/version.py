"""Version of the source that a run or policy came from."""

from __future__ import annotations

import subprocess
from functools import lru_cache
from pathlib import Path

import hotice


@lru_cache(maxsize=1)
def source_version() -> dict[str, str]:
    """Package version and, in a git checkout, the commit (with `+changes` when the tree differs from it)."""
    version = {"hotice": hotice.__version__}
    root = Path(hotice.__file__).parents[1]
    if (root / ".git").exists():
        try:
            git = ["git", "-C", str(root)]
            commit = subprocess.run([*git, "rev-parse", "HEAD"], capture_output=True, text=True, timeout=10)
            changes = subprocess.run(
                [*git, "status", "--porcelain", "-uno"], capture_output=True, text=True, timeout=10
            )
        except (OSError, subprocess.TimeoutExpired):
            return version
        if commit.returncode == 0:
            version["commit"] = commit.stdout.strip() + ("+changes" if changes.stdout.strip() else "")
    return version
