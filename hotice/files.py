"""Files appear whole or not at all."""

from __future__ import annotations

import os
from pathlib import Path

from hotice.errors import OutputError


def write_bytes(path: str | Path, content: bytes) -> Path:
    """Writes `content` aside in the same folder, then moves it to `path`; a file that was there stays until then.

    Raises:
        OutputError: the folder is missing or not writable, or `path` is a folder.
    """
    path = Path(path)
    aside = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        try:
            aside.write_bytes(content)
            os.replace(aside, path)
        except BaseException:
            aside.unlink(missing_ok=True)
            raise
    except OSError as error:
        raise OutputError(f"cannot write {path}: {error.strerror or error}") from None
    return path


def write_text(path: str | Path, content: str) -> Path:
    """`write_bytes` of UTF-8 text."""
    return write_bytes(path, content.encode())


def make_folder(path: str | Path) -> Path:
    """Creates a folder and its parents. Raises `OutputError`."""
    path = Path(path)
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"cannot create folder {path}: {error.strerror or error}") from None
    return path
