"""Writing a log beside a control loop: entries are handed over in memory, a thread brings them to the disk."""

from __future__ import annotations

import os
import threading
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from hotice import checks
from hotice.deploy.log.frames import MOST_PAYLOAD, LogHeader, frame
from hotice.errors import InvalidConfig, OutputError
from hotice.files import make_folder

WAITING_BYTES = 32 * 2**20
"""Entries that wait for the disk; more are dropped, and counted."""
FLUSH_S, SYNC_S = 0.1, 1.0
"""Time between writes, and between calls of `fsync`: what a crash of the machine costs."""


class LogWriter:
    """A log of one process: `write` never waits for the disk, and no fault of the disk ends what it is called from.

    Segments are FOLDER/NAME-000000.log and so on. A full or failing disk is said by `error` and counted in `dropped`.

    Args:
        folder: made if it is not there. name: of the process, lower-case letters and digits.
        kinds: type of each kind of entries, None: bytes of any length.
        about: JSON values for the reader: hashes, versions, options.
        segment_s: length of a segment. keep_s: segments that ended longer ago are removed; None: all stay.

    Raises:
        OutputError: the folder cannot be written to, or has segments of this name.
    """

    def __init__(
        self,
        folder: str | Path,
        name: str,
        kinds: Mapping[str, np.dtype | None],
        about: Mapping[str, Any] | None = None,
        *,
        segment_s: float = 10.0,
        keep_s: float | None = None,
    ) -> None:
        checks.number("segment_s", segment_s, checks.POSITIVE)
        if keep_s is not None:
            checks.number("keep_s", keep_s, checks.POSITIVE)
        if not (name.isascii() and name.isalnum() and name == name.lower()):
            raise InvalidConfig(f"name of a log is {name!r}: lower-case letters and digits are allowed")
        self.folder, self.name, self.kinds, self.about = make_folder(folder), name, dict(kinds), dict(about or {})
        self._number = {kind: i for i, kind in enumerate(self.kinds)}
        self.segment_s, self.keep_s = segment_s, keep_s
        self.written, self.dropped = 0, 0
        self.error: str | None = None
        self._waiting: list[tuple[float, bytes]] = []
        self._bytes, self._lock, self._ending = 0, threading.Lock(), threading.Event()
        self._segments: list[tuple[Path, float]] = []
        self._removed = 0
        if there := sorted(self.folder.glob(f"{name}-*.log")):
            raise OutputError(f"{self.folder} has a log already ({there[0].name}): give another folder")
        self._file, self._began = self._open(0), None
        self._thread = threading.Thread(target=self._run, name=f"log {name}", daemon=True)
        self._thread.start()

    def write(self, kind: str, time_s: float, entry: np.ndarray | bytes) -> bool:
        """Hands an entry over, a record of the kind's type or bytes; False: dropped, the disk is too slow or full."""
        dtype, payload = self.kinds[kind], entry if isinstance(entry, bytes) else entry.tobytes()
        if dtype is None and len(payload) > MOST_PAYLOAD:
            raise ValueError(f"an entry of {kind} has {len(payload)} bytes: at most {MOST_PAYLOAD} are allowed")
        if dtype is not None and len(payload) != dtype.itemsize:
            raise ValueError(f"an entry of {kind} has {len(payload)} bytes: {dtype.itemsize} are needed")
        whole = frame(self._number[kind], time_s, payload)
        with self._lock:
            if self.error is not None or self._bytes + len(whole) > WAITING_BYTES:
                self.dropped += 1
                return False
            self._waiting.append((time_s, whole))
            self._bytes += len(whole)
        return True

    def close(self) -> None:
        """Brings what waits to the disk; the log may be closed twice."""
        self._ending.set()
        self._thread.join()

    def __enter__(self) -> LogWriter:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _open(self, number: int) -> Any:
        path = self.folder / f"{self.name}-{number:06d}.log"
        header = LogHeader(writer=self.name, segment=number, kinds=self.kinds, about=self.about)
        try:
            # without a buffer: what `write` has taken is written
            file = open(path, "xb", buffering=0)
            file.write(header.to_bytes())
        except OSError as error:
            raise OutputError(f"cannot write {path}: {error.strerror or error}") from None
        self._segments.append((path, 0.0))
        return file

    def _run(self) -> None:
        unsynced = 0.0
        try:
            while not self._ending.wait(FLUSH_S):
                unsynced += FLUSH_S
                self._drain()
                if unsynced >= SYNC_S:
                    os.fsync(self._file.fileno())
                    unsynced = 0.0
            self._drain()
            os.fsync(self._file.fileno())
            self._file.close()
        except (OSError, OutputError) as error:
            with self._lock:
                self.error = f"the log in {self.folder} ended: {getattr(error, 'strerror', None) or error}"
                self.dropped += len(self._waiting)
                self._waiting, self._bytes = [], 0

    def _drain(self) -> None:
        """Writes what waits, into a new segment where one is full."""
        with self._lock:
            waiting, self._waiting, self._bytes = self._waiting, [], 0
        for i, (time_s, whole) in enumerate(waiting):
            try:
                self._write(time_s, whole)
            except (OSError, OutputError):
                with self._lock:
                    self.dropped += len(waiting) - i
                raise

    def _write(self, time_s: float, whole: bytes) -> None:
        self._began = time_s if self._began is None else self._began
        if time_s - self._began >= self.segment_s:
            os.fsync(self._file.fileno())
            self._file.close()
            self._segments[-1] = (self._segments[-1][0], time_s)
            self._file, self._began = self._open(len(self._segments) + self._removed), time_s
            self._forget(time_s)
        if self._file.write(whole) != len(whole):
            raise OutputError("the disk is full")
        self.written += 1

    def _forget(self, now_s: float) -> None:
        """Removes segments that ended before what is kept."""
        while self.keep_s is not None and len(self._segments) > 1 and self._segments[0][1] < now_s - self.keep_s:
            self._segments.pop(0)[0].unlink(missing_ok=True)
            self._removed += 1
