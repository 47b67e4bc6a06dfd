"""Faults of a message that must not be used."""

from __future__ import annotations

from typing import Literal, get_args

from hotice.errors import HoticeError

Reason = Literal["length", "header", "crc", "number", "mode", "text"]
"""length or header of the bytes; checksum; number not finite or impossible; mode that does not exist; text."""
REASONS: tuple[Reason, ...] = get_args(Reason)


class InvalidMessage(HoticeError):
    """A message that is cut, damaged or impossible; `reason` says which, so that links can count each kind."""

    def __init__(self, reason: Reason, text: str) -> None:
        super().__init__(text)
        self.reason: Reason = reason
