"""One owner of a folder: who writes there holds a lock, and a second process is refused before it writes."""

from __future__ import annotations

import contextlib
import fcntl
import os
import socket
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any

from hotice.errors import OutputError
from hotice.files import output_file

LOCK = "owner.lock"
"""File in the folder that is locked, and names who holds it; removed in the end."""


def try_lock(file: IO[Any]) -> bool:
    """Locks an open file, until it is closed or its process ends, however it ends; False where another one holds it."""
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def check_unowned(folder: Path) -> None:
    """Raises `OutputError` when another process owns the folder: before the work, and writing nothing."""
    path = folder / LOCK
    with _refusing(folder):
        if not path.is_file():
            return
        try:
            file = open(path, errors="replace")  # noqa: SIM115 - closed below
        except FileNotFoundError:  # its owner has ended meanwhile
            return
        with file:
            if not try_lock(file):
                raise _owned(folder, file)


@contextlib.contextmanager
def sole_owner(folder: Path) -> Iterator[None]:
    """Owns a folder within the context; makes it where it is missing, and removes it where it stays empty.

    Raises `OutputError` where another process owns it, or it cannot be made or locked.
    """
    with _refusing(folder):
        made = not folder.is_dir()
        folder.mkdir(parents=True, exist_ok=True)
        file = _take(folder)
    try:
        yield
    finally:
        # removed while it is locked: who opened it before finds it gone, see `_take`
        with contextlib.suppress(OSError):  # a file that nobody locks owns nothing
            (folder / LOCK).unlink(missing_ok=True)
        file.close()
        if made:
            with contextlib.suppress(OSError):  # it holds something
                folder.rmdir()


def _take(folder: Path) -> IO[Any]:
    path = output_file(folder / LOCK)
    while True:
        file = open(path, "a+", errors="replace")  # noqa: SIM115 - held until the end
        if not try_lock(file):
            error = _owned(folder, file)
            file.close()
            raise error
        if _is_at(file, path):
            file.truncate(0)
            file.write(f"process {os.getpid()} on {socket.gethostname()}")
            file.flush()
            return file
        file.close()  # its last owner removed it after it was opened here


def _is_at(file: IO[Any], path: Path) -> bool:
    """Whether the open file is still the one at `path`."""
    try:
        return os.path.samestat(os.fstat(file.fileno()), path.stat())
    except FileNotFoundError:
        return False


def _owned(folder: Path, file: IO[Any]) -> OutputError:
    file.seek(0)
    who = file.read(200).strip() or "another process"
    return OutputError(f"{folder}: {who} is at work in it: wait until that ends, or give another folder as --out")


@contextlib.contextmanager
def _refusing(folder: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise OutputError(f"{folder}: cannot be locked for this run: {error.strerror or error}") from None
