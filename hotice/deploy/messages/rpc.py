"""Calls to the robot's services: `unitree_api` Request and Response, to and from bytes on the wire.

Little-endian CDR with text and a sequence of bytes; ours send no bytes, and those of an answer are left unread.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

from hotice.deploy.messages.cdr import HEADER
from hotice.deploy.messages.invalid import InvalidMessage

LARGEST_TEXT = 65536
"""Bytes of text; the answers we ask for have fewer than a hundred."""
_REQUEST = struct.Struct("<qqqi?3x")
_RESPONSE = struct.Struct("<qqi")


@dataclass(frozen=True, kw_only=True)
class Request:
    """A call: `id` comes back in the answer, `parameter` is JSON."""

    id: int
    api_id: int
    parameter: str

    def encode(self) -> bytes:
        """Lease 0, priority 0, an answer wanted."""
        return HEADER + _with_text(_REQUEST.pack(self.id, self.api_id, 0, 0, False), self.parameter)

    @classmethod
    def decode(cls, data: bytes) -> Request:
        """Raises `InvalidMessage`."""
        (id_, api_id, _, _, _), text = _open("Request_", _REQUEST, data)
        return cls(id=id_, api_id=api_id, parameter=text)


@dataclass(frozen=True, kw_only=True)
class Response:
    """An answer: `code` 0 is success, `data` is JSON or empty."""

    id: int
    api_id: int
    code: int
    data: str

    def encode(self) -> bytes:
        return HEADER + _with_text(_RESPONSE.pack(self.id, self.api_id, self.code), self.data)

    @classmethod
    def decode(cls, data: bytes) -> Response:
        """Raises `InvalidMessage`."""
        (id_, api_id, code), text = _open("Response_", _RESPONSE, data)
        return cls(id=id_, api_id=api_id, code=code, data=text)


def _with_text(head: bytes, text: str) -> bytes:
    raw = text.encode() + b"\0"
    body = head + struct.pack("<I", len(raw)) + raw
    return body + b"\0" * (-len(body) % 4) + struct.pack("<I", 0)


def _open(name: str, head: struct.Struct, data: bytes) -> tuple[tuple, str]:
    body = data[len(HEADER) :]
    if data[:3] != HEADER[:3]:
        raise InvalidMessage(
            "header", f"{name} begins with {data[:4].hex(' ') or 'nothing'}: {HEADER.hex(' ')} is needed"
        )
    if len(body) < head.size + 4:
        raise InvalidMessage("length", f"{name} has {len(body)} bytes: {head.size + 4} are the least")
    (size,) = struct.unpack_from("<I", body, head.size)
    text = body[head.size + 4 : head.size + 4 + size]
    if not 1 <= size <= LARGEST_TEXT or len(text) < size:
        raise InvalidMessage("length", f"{name} says its text has {size} bytes: {len(body) - head.size - 4} are left")
    if text.find(b"\0") != size - 1:
        raise InvalidMessage("text", f"{name} has a text that does not end at its first zero byte")
    try:
        return head.unpack_from(body), text[:-1].decode()
    except UnicodeDecodeError as error:
        raise InvalidMessage("text", f"{name} has a text that is not UTF-8: {error.reason}") from None
