"""The format of a log's segments: a header, then frames of one entry each.

Segment: `MAGIC`, length of the header (u32), the header (JSON, UTF-8), its checksum (u32). Frame: length of the payload
(u32), number of the kind (u16), checksum (u32) of time, kind and payload, time (f64) [s], payload. Little-endian, not
aligned; checksums are CRC-32. A segment says all that is needed to read it.
"""

from __future__ import annotations

import json
import math
import struct
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from hotice.documents import parse_json
from hotice.errors import InputError

MAGIC = b"HOTICE-LOG-1\n"
LENGTH = struct.Struct("<I")
FRAME = struct.Struct("<IHId")
TIMED = struct.Struct("<dH")
MOST_PAYLOAD = 2**20
MOST_HEADER = 2**18
MOST_KINDS = 256


@dataclass(frozen=True, kw_only=True)
class LogHeader:
    """Name of the log's writer, number of the segment, kinds of entries, and whatever else a reader should know."""

    writer: str
    segment: int
    kinds: Mapping[str, np.dtype | None]
    """Type of each kind's entries, None: bytes of any length. Its place is its number."""
    about: Mapping[str, Any] = field(default_factory=dict)
    """Hashes of scene and policy, versions, options: JSON values."""

    def to_bytes(self) -> bytes:
        """Beginning of a segment."""
        kinds = {name: None if kind is None else _described(kind) for name, kind in self.kinds.items()}
        said = {"writer": self.writer, "segment": self.segment, "kinds": kinds, "about": dict(self.about)}
        text = json.dumps(said, allow_nan=False).encode()
        return MAGIC + LENGTH.pack(len(text)) + text + LENGTH.pack(zlib.crc32(text))

    @classmethod
    def of(cls, content: bytes) -> tuple[LogHeader, int]:
        """Header of a segment, and where its frames begin. Raises `InputError`."""
        start = len(MAGIC) + LENGTH.size
        if not content.startswith(MAGIC):
            raise InputError(f"is not a log of a robot: it does not begin with {MAGIC!r}")
        length = LENGTH.unpack_from(content, len(MAGIC))[0] if len(content) >= start else 0
        end = start + length
        if not 2 <= length <= MOST_HEADER or end + LENGTH.size > len(content):
            raise InputError("the header of the log is cut short or damaged")
        text = content[start:end]
        if zlib.crc32(text) != LENGTH.unpack_from(content, end)[0]:
            raise InputError("the header of the log is damaged: its checksum does not fit")
        return cls._read(text), end + LENGTH.size

    @classmethod
    def _read(cls, text: bytes) -> LogHeader:
        said = parse_json("the header of the log", text)
        try:
            kinds = {str(n): None if k is None else _dtype(k) for n, k in said["kinds"].items()}
            header = cls(writer=str(said["writer"]), segment=int(said["segment"]), kinds=kinds, about=said["about"])
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
            raise InputError(f"the header of the log says nothing that can be read: {error}") from None
        if len(kinds) > MOST_KINDS or not isinstance(header.about, dict):
            raise InputError("the header of the log is not one of ours")
        return header


def frame(kind: int, time_s: float, payload: bytes) -> bytes:
    """One entry as bytes."""
    check = zlib.crc32(payload, zlib.crc32(TIMED.pack(time_s, kind)))
    return FRAME.pack(len(payload), kind, check, time_s) + payload


def frames(content: bytes, start: int) -> Iterator[tuple[int, float, bytes]]:
    """Kind, time [s] and payload of every whole frame from `start` on; ends at the first that is cut or damaged."""
    at = start
    while at + FRAME.size <= len(content):
        length, kind, check, time_s = FRAME.unpack_from(content, at)
        payload = content[at + FRAME.size : at + FRAME.size + length]
        if length > MOST_PAYLOAD or len(payload) < length or not math.isfinite(time_s):
            return
        if zlib.crc32(payload, zlib.crc32(TIMED.pack(time_s, kind))) != check:
            return
        yield kind, time_s, payload
        at += FRAME.size + length


def _described(kind: np.dtype) -> Any:
    """JSON value of a type of numbers."""
    if kind.hasobject:
        raise ValueError(f"entries of {kind} hold objects: only numbers can be logged")
    return json.loads(json.dumps(np.lib.format.dtype_to_descr(kind)))


def _dtype(said: Any) -> np.dtype:
    """Type of numbers of its JSON value. Raises `ValueError` or `TypeError`."""
    kind = np.lib.format.descr_to_dtype(_tuples(said))
    if kind.hasobject or not 1 <= kind.itemsize <= MOST_PAYLOAD:
        raise ValueError(f"{kind} is no type of numbers")
    return kind


def _tuples(said: Any) -> Any:
    """Lists in place of JSON's: a description is a list of fields, each a tuple, shapes are tuples too."""
    if isinstance(said, str):
        return said
    fields = []
    for name, kind, *shape in said:
        fields.append((name, _tuples(kind), *(tuple(int(n) for n in s) for s in shape)))
    return fields
