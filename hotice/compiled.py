"""`numba.njit` with a cache on disk that is as old as all of hotice's compiled sources.

numba compiles a cached function anew when its own file changes, but not when a function that it calls, in another file,
does: the stale machine code may crash. Here the cache lies in a folder named by the content of every module that
compiles, and of the user's own: what numba finds there, it runs.
"""

from __future__ import annotations

import hashlib
import os
import warnings
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from types import FunctionType
from typing import Any

import numba
from numba.core import config

from hotice.caches import NotKept, cache_folder
from hotice.compiling import COMPILING
from hotice.errors import OutputError

_PACKAGE = Path(__file__).resolve().parent


def compiled(function: Callable | None = None, /, **options: Any) -> Any:
    """Decorator: `numba.njit(**options)`, cached. Kept in $NUMBA_CACHE_DIR, else as `hotice.caches` says."""
    COMPILING.watch()
    if function is None:
        return lambda f: compiled(f, **options)
    if options.get("parallel"):
        function = _copied(function, "_parallel")
    folder = kept_in()
    if folder is None:
        return numba.njit(**options)(function)
    before = config.CACHE_DIR  # type: ignore[attr-defined]
    config.CACHE_DIR = str(folder)  # type: ignore[attr-defined]
    try:
        return numba.njit(cache=True, **options)(function)
    finally:
        config.CACHE_DIR = before  # type: ignore[attr-defined]


def _copied(function: Callable, ending: str) -> Callable:
    """The function under another name.

    numba keeps what it compiles by name and types, whatever the options were: of a function that is compiled for one
    thread and for several, it would load for both what was compiled first.
    """
    copy = FunctionType(function.__code__, function.__globals__, function.__name__ + ending, function.__defaults__)
    copy.__qualname__, copy.__module__ = function.__qualname__ + ending, function.__module__
    copy.__doc__ = function.__doc__
    return copy


@lru_cache
def kept_in() -> Path | None:
    """Where compiled functions are kept; None: nowhere, with a warning.

    Never where others could have put something, which would be run.
    """
    given = os.environ.get("NUMBA_CACHE_DIR")
    try:
        return cache_folder(f"numba-{_digest()}", Path(given) / "hotice" if given else None)
    except OutputError as error:
        warnings.warn(f"fields and geometry are compiled anew in each process: {error}", NotKept, stacklevel=3)
        return None


def _digest() -> str:
    """Digest of the sources of all modules that compile."""
    digest = hashlib.sha256()
    for path in sorted(_PACKAGE.rglob("*.py")):
        text = path.read_bytes()
        if b"hotice.compiled" in text:
            digest.update(text)
    return digest.hexdigest()[:16]
