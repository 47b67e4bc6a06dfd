"""`numba.njit` with a cache on disk that is as old as all of hotice's compiled sources.

numba compiles a cached function anew when its own file changes, but not when a function that it calls, in another file,
does: the stale machine code may crash. Here the cache lies in a folder named by the content of every module that
    compiles.
"""

from __future__ import annotations

import hashlib
import os
import tempfile
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any

import numba
from numba.core import config

_PACKAGE = Path(__file__).resolve().parent


def compiled(function: Callable | None = None, /, **options: Any) -> Any:
    """Decorator: `numba.njit(**options)`, cached. Kept in $NUMBA_CACHE_DIR, else in the user's cache."""
    if function is None:
        return lambda f: compiled(f, **options)
    before = config.CACHE_DIR  # type: ignore[attr-defined]
    config.CACHE_DIR = str(_cache_folder())  # type: ignore[attr-defined]
    try:
        return numba.njit(cache=True, **options)(function)
    finally:
        config.CACHE_DIR = before  # type: ignore[attr-defined]


@lru_cache
def _cache_folder() -> Path:
    home = os.environ.get("NUMBA_CACHE_DIR") or os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    folder = Path(home) / "hotice" / f"numba-{_digest()}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        pass
    if os.access(folder, os.W_OK):
        return folder
    # of this process alone: others could have filled a shared one
    return Path(tempfile.mkdtemp(prefix="hotice-numba-"))


def _digest() -> str:
    """Digest of the sources of all modules that compile."""
    digest = hashlib.sha256()
    for path in sorted(_PACKAGE.rglob("*.py")):
        text = path.read_bytes()
        if b"hotice.compiled" in text:
            digest.update(text)
    return digest.hexdigest()[:16]
