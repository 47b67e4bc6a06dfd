"""Reading a log: every entry of each kind, in the order in which it was written."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hotice.deploy.log.frames import FRAME, LogHeader, frames
from hotice.errors import InputError
from hotice.files import is_folder, read_bytes

MOST_SEGMENT_BYTES = 2**30


class Entries(NamedTuple):
    """Entries of one kind: times (n,) [s], and records (n,) of the kind's type or a list of n bytes."""

    time_s: NDArray[np.float64]
    records: Any


@dataclass(frozen=True, kw_only=True)
class Log:
    """Log of one process."""

    writer: str
    about: Mapping[str, Any]
    """JSON values of its writer: hashes, versions, options."""
    kinds: Mapping[str, np.dtype | None]
    """Type of each kind's entries, None: bytes."""
    entries: Mapping[str, Entries]
    """By kind."""
    first_segment: int
    """Number of the first segment that is there: not 0 for a ring whose beginning is gone."""
    torn_bytes: int
    """Bytes at the ends of segments that hold no whole entry: one was being written, or the file is damaged."""


def read_log(folder: str | Path, name: str) -> Log:
    """Log of the process `name` in a folder; the first segments may have been removed.

    Raises:
        InputError: there is none, or a segment is not one, or of another run.
    """
    folder = Path(folder)
    if not is_folder(folder):
        raise InputError(f"{folder}: no such folder")
    paths = sorted(folder.glob(f"{name}-*.log"))
    if not paths:
        names = sorted({path.name.rpartition("-")[0] for path in folder.glob("*-*.log")})
        raise InputError(f"{folder}: holds no log of {name!r}; there are logs of {', '.join(names) or 'nothing'}")
    found: dict[str, list[tuple[float, bytes]]] = defaultdict(list)
    first: LogHeader | None = None
    torn, number = 0, 0
    for path in paths:
        content = read_bytes(path, MOST_SEGMENT_BYTES)
        try:
            header, at = LogHeader.of(content)
        except InputError as error:
            raise InputError(f"{path}: {error}") from None
        if first is None:
            first, number = header, header.segment
        if (header.writer, header.kinds, header.about, header.segment) != (name, first.kinds, first.about, number):
            raise InputError(f"{path}: is not the next segment of the log: {path.parent} mixes logs, or one is lost")
        number += 1
        kinds = list(header.kinds)
        end = at
        for kind, time_s, payload in frames(content, at):
            dtype = header.kinds[kinds[kind]] if kind < len(kinds) else None
            if kind >= len(kinds) or dtype is not None and len(payload) != dtype.itemsize:
                break
            found[kinds[kind]].append((time_s, payload))
            end += len(payload) + FRAME.size
        torn += len(content) - end
    assert first is not None
    entries = {kind: _entries(found[kind], dtype) for kind, dtype in first.kinds.items()}
    return Log(
        writer=name,
        about=first.about,
        kinds=first.kinds,
        entries=entries,
        first_segment=first.segment,
        torn_bytes=torn,
    )


def _entries(found: list[tuple[float, bytes]], dtype: np.dtype | None) -> Entries:
    time_s = np.array([t for t, _ in found], dtype=np.float64)
    payloads = [payload for _, payload in found]
    return Entries(time_s, payloads if dtype is None else np.frombuffer(b"".join(payloads), dtype))
