"""Claims on bytes of an open file, of which one process at a time has each; the system frees them when it dies."""

from __future__ import annotations

import fcntl
import os
import struct

GUARD, RUNNER = 0, 1
"""Bytes that stand for the two users of a slot."""


def claim(descriptor: int, byte: int) -> bool:
    """Takes the byte for as long as this file stays open; False if another open file has it."""
    # a lock of the open file, not of the process: closing another file of the same name does not lose it
    asked = struct.pack("@hhqqi4x", fcntl.F_WRLCK, os.SEEK_SET, byte, 1, 0)
    try:
        fcntl.fcntl(descriptor, fcntl.F_OFD_SETLK, asked)
    except (BlockingIOError, PermissionError):
        return False
    return True
