"""Where the log of a deployment lies that nobody asked for: a ring of its last minute, in the user's own cache."""

from __future__ import annotations

import os
import re
import shutil
import time
from pathlib import Path

from hotice.caches import cache_folder
from hotice.files import make_folder

RING_S = 60.0
"""What a ring keeps at least [s]."""
KEPT = 5
"""So many rings of each robot are kept; older ones are removed."""
_RING = re.compile(r"\d{8}-\d{6}-\d+")


def ring_folder(slot: str) -> Path:
    """A new folder for this start, beside those of the last ones. Raises `OutputError`."""
    robot = make_folder(cache_folder("logs") / slot)
    rings = sorted(path for path in robot.iterdir() if _RING.fullmatch(path.name) and path.is_dir())
    for old in rings[: max(0, len(rings) - KEPT + 1)]:
        # one that cannot be removed is left; the next start tries again
        shutil.rmtree(old, ignore_errors=True)
    return make_folder(robot / f"{time.strftime('%Y%m%d-%H%M%S')}-{os.getpid()}")
