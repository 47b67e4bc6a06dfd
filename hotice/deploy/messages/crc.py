"""The checksum of LowCmd and LowState: CRC-32/MPEG-2 over the C struct's 32-bit words but the last, through zlib.

The vendor feeds each little-endian word from its highest bit (unitree_sdk2, `Crc32Core`); zlib's CRC-32 has the same
polynomial but takes every byte from its lowest bit. So: swap the bytes of each word, reflect each byte, let zlib run,
undo its last inversion and reflect the result. Padding counts as zero whatever it holds.
"""

from __future__ import annotations

import zlib
from functools import cache

import numpy as np

from hotice.deploy.messages.structs import Struct

_REFLECTED = bytes(int(f"{byte:08b}"[::-1], 2) for byte in range(256))


def crc32_mpeg2(data: bytes) -> int:
    """CRC-32/MPEG-2 of bytes: polynomial 0x04C11DB7, start 0xFFFFFFFF, nothing reflected, no last inversion."""
    reflected = zlib.crc32(data.translate(_REFLECTED)) ^ 0xFFFFFFFF
    return int.from_bytes(reflected.to_bytes(4, "little").translate(_REFLECTED), "big")


def record_crc(struct: Struct, record: np.ndarray) -> int:
    """The checksum of a record () that ends with its `crc`, whatever that field holds now."""
    words = np.frombuffer(record.tobytes(), "<u4")[:-1] & _not_padding(struct)
    # the highest byte of each word first
    return crc32_mpeg2(words.byteswap().tobytes())


@cache
def _not_padding(struct: Struct) -> np.ndarray:
    # all bits of the C struct's words but those of padding
    held = np.where(struct.record_places < len(struct.wire_places), 0xFF, 0).astype(np.uint8)
    return np.frombuffer(held.tobytes(), "<u4")[:-1]
