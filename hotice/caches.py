"""Folders of the user's own for what is kept between calls: solved fields, plans, compiled functions.

`$HOTICE_CACHE`, else `$XDG_CACHE_HOME/hotice`, else `~/.cache/hotice`, with a folder for each kind of thing. It is made
for its owner alone (0700), and one that others own or can write is not used: what lies there is read back, and
compiled functions are run.
"""

from __future__ import annotations

import atexit
import os
import stat
import tempfile
import warnings
from pathlib import Path

from hotice.errors import OutputError

VARIABLE = "HOTICE_CACHE"
OTHERS_WRITE = stat.S_IWGRP | stat.S_IWOTH


class NotKept(UserWarning):
    """Something that cannot be kept for the next process."""


def cache_folder(kind: str, root: Path | None = None) -> Path:
    """The folder of a kind of thing, which this user alone can write; `root`: instead of that of all kinds.

    Raises:
        OutputError: there is no home folder, it cannot be written, or others can write the folder. Says what to set.
    """
    folder = (cache_root() if root is None else root) / kind
    try:
        folder.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        folder.mkdir(mode=0o700, exist_ok=True)
        status = folder.stat()
    except OSError as error:
        raise OutputError(f"cannot keep anything in {folder}: {error.strerror or error}: {_mend()}") from None
    if status.st_uid != os.geteuid():
        raise OutputError(f"{folder} belongs to another user and is not used: {_mend()}")
    if status.st_mode & OTHERS_WRITE:
        raise OutputError(
            f"{folder} can be written by other users (mode {stat.S_IMODE(status.st_mode):o}) and is not used: remove "
            f"it, or take their right away with chmod 700 if nobody used it, or {_mend()}"
        )
    if not os.access(folder, os.W_OK | os.X_OK):
        raise OutputError(f"cannot write {folder}: {_mend()}")
    return folder


def kept_or_temporary(kind: str, root: Path | None = None) -> Path:
    """`cache_folder`, or with a warning `NotKept` a temporary folder of this process, which is removed at its end."""
    try:
        return cache_folder(kind, root)
    except OutputError as error:
        warnings.warn(f"{kind} is made anew in each process: {error}", NotKept, stacklevel=3)
    # never one that others could have filled
    holder = tempfile.TemporaryDirectory(prefix=f"hotice-{kind}-")
    atexit.register(holder.cleanup)
    return Path(holder.name)


def settle_torch() -> None:
    """Sets where torch keeps what it compiles, unless the user did: its folder, made at an import, is in /tmp else."""
    if "TORCHINDUCTOR_CACHE_DIR" not in os.environ:
        os.environ["TORCHINDUCTOR_CACHE_DIR"] = str(kept_or_temporary("torch"))


def cache_root() -> Path:
    """The folder of all kinds, which need not exist. Raises `OutputError` where the user has no home folder."""
    if given := os.environ.get(VARIABLE):
        return Path(given)
    if given := os.environ.get("XDG_CACHE_HOME"):
        return Path(given) / "hotice"
    try:
        return Path.home() / ".cache" / "hotice"
    except RuntimeError:  # neither $HOME nor an entry in passwd
        raise OutputError(f"there is no home folder: {_mend()}") from None


def _mend() -> str:
    return f"set {VARIABLE} to a folder of your own"
