"""The slot of one robot: a file in /dev/shm that the guard makes and unlinks, and that a runner opens."""

from __future__ import annotations

import mmap
import os
import re
from pathlib import Path

import numpy as np

from hotice.deploy.slot.claims import GUARD, RUNNER, claim
from hotice.deploy.slot.double_buffer import DoubleBuffer
from hotice.deploy.slot.records import MARK, SIZE, STATUS_AT, TARGETS_AT
from hotice.errors import HoticeError

FOLDER = Path("/dev/shm")
PREFIX = "hotice-slot-"
_NAME = re.compile(r"[a-z0-9][a-z0-9_-]{0,39}")


class SlotError(HoticeError):
    """A slot that is in use, missing or of another layout; says what to do."""


def slot_path(name: str) -> Path:
    """Where the slot of this name lies. Raises `SlotError` for an impossible name."""
    if not _NAME.fullmatch(name):
        raise SlotError(
            f"name of a slot {name!r}: 1 to 40 of a-z, 0-9, _ and - are needed, the first a letter or digit"
        )
    return FOLDER / f"{PREFIX}{name}"


class _Slot:
    """A mapped slot whose claim this process has."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor: int | None = descriptor
        self._memory = mmap.mmap(descriptor, SIZE)
        self._targets = DoubleBuffer(self._memory, TARGETS_AT)
        self._status = DoubleBuffer(self._memory, STATUS_AT)

    def close(self) -> None:
        """Unmaps it and frees the claim; a second time does nothing."""
        if self._descriptor is None:
            return
        self._targets.release()
        self._status.release()
        self._memory.close()
        os.close(self._descriptor)
        self._descriptor = None


class GuardSlot(_Slot):
    """The guard's end: makes the file, reads targets, writes the status, unlinks the file when closed."""

    def __init__(self, name: str) -> None:
        """Raises `SlotError` while another guard has this name; what a dead one left is replaced."""
        self._path = slot_path(name)
        super().__init__(_make(self._path, name))
        self._memory[: len(MARK)] = MARK

    @property
    def torn(self) -> int:
        """Torn records of targets so far."""
        return self._targets.torn

    def targets(self) -> np.ndarray | None:
        """The newest targets, a record (); None before the first and when torn."""
        return self._targets.read()

    def tell(self, status: np.ndarray) -> None:
        """Makes the status () the newest."""
        self._status.write(status)

    def close(self) -> None:
        if self._descriptor is not None and _same(self._path, self._descriptor):
            self._path.unlink()
        super().close()


class RunnerSlot(_Slot):
    """The runner's end: writes targets, reads the status."""

    def __init__(self, name: str) -> None:
        """Raises `SlotError` without a living guard, for another layout, and while another runner has the slot."""
        path = slot_path(name)
        descriptor = _open(path, 0)
        if descriptor is None:
            raise SlotError(f"there is no slot {name!r}: start its guard first")
        try:
            if os.fstat(descriptor).st_size != SIZE or os.pread(descriptor, len(MARK), 0) != MARK:
                raise SlotError(f"slot {name!r} is of another layout: start guard and runner of one version")
            if claim(descriptor, GUARD):
                raise SlotError(f"slot {name!r} was left by a guard that is gone: start its guard first")
            if not claim(descriptor, RUNNER):
                raise SlotError(f"slot {name!r} has a runner already: stop that one first")
            super().__init__(descriptor)
        except SlotError:
            os.close(descriptor)
            raise

    def put(self, targets: np.ndarray) -> None:
        """Makes the targets () the newest."""
        self._targets.write(targets)

    def status(self) -> np.ndarray | None:
        """The newest status, a record (); None before the first and when torn."""
        return self._status.read()


def _make(path: Path, name: str) -> int:
    while True:
        descriptor = _open(path, os.O_CREAT)
        if descriptor is None:
            raise SlotError(f"there is no folder {path.parent}: guard and runner need Linux's shared memory")
        if not claim(descriptor, GUARD):
            os.close(descriptor)
            raise SlotError(f"slot {name!r} has a guard already: stop that one, or choose another name")
        if not _same(path, descriptor):
            # its guard unlinked it between our opening and claiming
            os.close(descriptor)
            continue
        if os.fstat(descriptor).st_size == 0:
            os.ftruncate(descriptor, SIZE)
            return descriptor
        # left by a guard that died: a runner may still have it mapped, so it is not used again
        path.unlink()
        os.close(descriptor)


def _open(path: Path, flags: int) -> int | None:
    try:
        return os.open(path, os.O_RDWR | os.O_CLOEXEC | os.O_NOFOLLOW | flags, 0o600)
    except FileNotFoundError:
        return None
    except OSError as error:
        raise SlotError(f"{path} cannot be opened: {error.strerror}; another user's, or no plain file") from None


def _same(path: Path, descriptor: int) -> bool:
    try:
        there = os.stat(path, follow_symlinks=False)
    except FileNotFoundError:
        return False
    ours = os.fstat(descriptor)
    return (there.st_dev, there.st_ino) == (ours.st_dev, ours.st_ino)
