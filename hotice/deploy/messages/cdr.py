"""Records to and from bytes on the wire: plain little-endian CDR, one gather of bytes per message."""

from __future__ import annotations

import numpy as np

from hotice.deploy.messages.invalid import InvalidMessage
from hotice.deploy.messages.structs import Struct

HEADER = b"\x00\x01\x00\x00"
"""Encapsulation: plain CDR, little-endian, no options."""


def encode(struct: Struct, record: np.ndarray) -> bytes:
    """The record () as a message, header included; whatever its padding holds is sent as zeros."""
    source = np.frombuffer(record.tobytes() + b"\0", np.uint8)
    body = source[struct.wire_places].tobytes()
    return HEADER + body + b"\0" * (-len(body) % 4)


def decode(struct: Struct, data: bytes) -> np.ndarray:
    """The message as a read-only record (), its padding zero.

    Raises:
        InvalidMessage: a header other than plain little-endian CDR, or another length. Numbers are not looked at.
    """
    if len(data) < len(HEADER) or data[:3] != HEADER[:3] or data[3] > 3:
        raise InvalidMessage(
            "length" if len(data) < len(HEADER) else "header",
            f"{struct.name} begins with {data[:4].hex(' ') or 'nothing'}: plain little-endian CDR begins with "
            f"{HEADER.hex(' ')}",
        )
    size = len(struct.wire_places)
    if len(data) - len(HEADER) not in (size, size + -size % 4):
        raise InvalidMessage(
            "length", f"{struct.name} has {len(data) - len(HEADER)} bytes behind its header: {size} are needed"
        )
    source = np.frombuffer(data[len(HEADER) : len(HEADER) + size] + b"\0", np.uint8)
    return np.frombuffer(source[struct.record_places].tobytes(), struct.dtype).reshape(())
