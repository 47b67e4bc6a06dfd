"""A look at a slot from outside: who shows it claims nothing and writes nothing."""

from __future__ import annotations

import mmap
import os

import numpy as np

from hotice.deploy.slot.double_buffer import DoubleBuffer
from hotice.deploy.slot.records import MARK, SIZE, STATUS_AT, TARGETS_AT
from hotice.deploy.slot.slot import SlotError, slot_path


class SlotWatch:
    """Reads the newest targets and status of a slot. Use `with`, or close it."""

    def __init__(self, name: str) -> None:
        """Raises `SlotError`: no such slot, or one of another layout."""
        try:
            with open(slot_path(name), "rb") as file:
                if os.fstat(file.fileno()).st_size != SIZE or file.read(len(MARK)) != MARK:
                    raise SlotError(f"slot {name!r} is of another layout: use one version of hotice")
                self._memory = mmap.mmap(file.fileno(), SIZE, access=mmap.ACCESS_READ)
        except OSError as error:
            raise SlotError(f"there is no slot {name!r} to look at: {error.strerror}") from None
        self._targets = DoubleBuffer(self._memory, TARGETS_AT)
        self._status = DoubleBuffer(self._memory, STATUS_AT)

    def targets(self) -> np.ndarray | None:
        """The newest targets, a record (); None before the first and when torn."""
        return self._targets.read()

    def status(self) -> np.ndarray | None:
        """The newest status, a record (); None before the first and when torn."""
        return self._status.read()

    def close(self) -> None:
        """Unmaps it."""
        self._targets.release()
        self._status.release()
        self._memory.close()

    def __enter__(self) -> SlotWatch:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
