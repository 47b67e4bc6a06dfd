"""Files are read within limits and appear whole or not at all."""

from __future__ import annotations

import os
import stat
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from hotice.errors import InputError, OutputError


def read_bytes(path: str | Path, max_bytes: int) -> bytes:
    """The content of a regular file, never more than `max_bytes` of it.

    A pipe or device, which might never end, is refused before a byte is read; so is a file that says it is larger.

    Raises:
        InputError: the file is missing, of another kind, larger than `max_bytes` or not readable.
    """
    path = Path(path)
    try:
        _check_regular(path, path.stat(), max_bytes)
        # it may have become a pipe meanwhile, whose opening would wait for its other end
        with open(os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC), "rb") as file:
            _check_regular(path, os.fstat(file.fileno()), max_bytes)
            # files of /proc say that they are empty
            content = file.read(max_bytes + 1)
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from None
    except ValueError as error:  # a NUL in the path
        raise InputError(f"{str(path)!r}: cannot be read: {error}") from None
    if len(content) > max_bytes:
        raise InputError(f"{path}: is larger than {max_bytes // 2**20} MiB")
    return content


def is_file(path: str | Path) -> bool:
    """Whether there is a regular file; False for text that no path can be (too long, with a NUL)."""
    return _is(Path(path).is_file)


def is_folder(path: str | Path) -> bool:
    """Whether there is a folder; False for text that no path can be, and for no text: the present folder is `.`."""
    return str(path) != "" and _is(Path(path).is_dir)


@contextmanager
def written_aside(path: str | Path) -> Iterator[Path]:
    """A hidden file in the same folder and with the same ending, to be written within the context.

    At its end the file moves to `path`, or to where a link there points; after an error it is removed, and what was at
    `path` stays.

    Raises:
        OutputError: the folder is missing or not writable, `path` is no name of a file, see `output_file`, or writing
            failed.
    """
    path = Path(path)
    target = output_file(path)
    aside = target.with_name(f".{os.getpid()}.{path.name}")
    try:
        try:
            yield aside
            os.replace(aside, output_file(target))
        except BaseException:
            aside.unlink(missing_ok=True)
            raise
    except OSError as error:
        raise OutputError(f"cannot write {path}: {error.strerror or error}") from None


def write_bytes(path: str | Path, content: bytes) -> Path:
    """Writes `content` aside in the same folder, then moves it to `path`; a file that was there stays until then.

    Raises:
        OutputError: the folder is missing or not writable, or `path` is a folder.
    """
    with written_aside(path) as aside:
        aside.write_bytes(content)
    return Path(path)


def write_text(path: str | Path, content: str) -> Path:
    """`write_bytes` of UTF-8 text."""
    return write_bytes(path, content.encode())


def output_file(path: str | Path) -> Path:
    """Where a file at `path` would be written: there, or where a link there points, so that links stay.

    Raises:
        OutputError: a folder, device, pipe or socket is there, or a link to one, or the name is none.
    """
    path = Path(path)
    try:
        target = Path(os.path.realpath(path)) if path.is_symlink() else path
        kind = target.stat().st_mode
    except FileNotFoundError:
        return target
    except OSError as error:
        raise OutputError(f"cannot write {path}: {error.strerror or error}") from None
    except ValueError as error:  # a NUL in the path
        raise OutputError(f"cannot write {str(path)!r}: {error}") from None
    if stat.S_ISREG(kind):
        return target
    what = "a folder" if stat.S_ISDIR(kind) else "a device, pipe or socket"
    raise OutputError(f"cannot write {path}: it is {what}, the name of a file is needed")


def make_folder(path: str | Path) -> Path:
    """Creates a folder and its parents. Raises `OutputError`."""
    path = Path(path)
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"cannot create folder {path}: {error.strerror or error}") from None
    except ValueError as error:  # a NUL in the path
        raise OutputError(f"cannot create folder {str(path)!r}: {error}") from None
    return path


def check_writable(path: str | Path) -> None:
    """Raises `OutputError` before the work rather than after it, when its result could not be written to this file."""
    folder = output_file(path).parent
    if not folder.is_dir():
        raise OutputError(f"cannot write {path}: folder {folder} does not exist")
    if not os.access(folder, os.W_OK):
        raise OutputError(f"cannot write {path}: folder {folder} is not writable")


def check_folder(path: str | Path) -> None:
    """Raises `OutputError` before the work when results could not be written to this folder; makes nothing."""
    path = Path(path)
    there = path
    while not os.path.lexists(there) and there != there.parent:
        there = there.parent
    if not there.is_dir():
        raise OutputError(f"cannot create folder {path}: {there} is no folder")
    if not os.access(there, os.W_OK | os.X_OK):
        why = "is on a read-only file system" if os.statvfs(there).f_flag & os.ST_RDONLY else "is not writable"
        raise OutputError(f"cannot write to folder {path}: {there} {why}")


def _check_regular(path: Path, status: os.stat_result, max_bytes: int) -> None:
    if not stat.S_ISREG(status.st_mode):
        raise InputError(f"{path}: is a folder, pipe or device: a regular file is needed")
    if status.st_size > max_bytes:
        raise InputError(f"{path}: is larger than {max_bytes // 2**20} MiB")


def _is(question: Callable[[], bool]) -> bool:
    try:
        return question()
    except (OSError, ValueError):
        return False
