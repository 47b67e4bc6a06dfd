"""LZF decompression, the compression inside `binary_compressed` PCD files."""

from __future__ import annotations

import numpy as np

from hotice.compiled import compiled
from hotice.errors import InvalidMap

MAX_RATIO = 88
"""Three bytes stand for at most 264: what claims to be larger is a lie and is refused before memory is taken."""


def decompress(packed: bytes, size: int) -> bytes:
    """The `size` bytes that `packed` stands for. Raises `InvalidMap` unless it holds exactly these."""
    if size > MAX_RATIO * len(packed):
        raise InvalidMap(
            f"compressed data of {len(packed):,} bytes claim {size:,}: at most {MAX_RATIO} times are possible"
        )
    out = np.empty(size, dtype=np.uint8)
    if _decompress(np.frombuffer(packed, dtype=np.uint8), out) != size:
        raise InvalidMap(f"compressed data are damaged: they do not hold the {size:,} bytes of the header")
    return out.tobytes()


@compiled
def _decompress(packed, out):
    """Bytes written, or -1 when a run leaves `packed` or `out`.

    A control byte below 32 precedes that many literal bytes and one more. Otherwise its upper 3 bits are a length (7:
    the next byte is added) less 2, its lower 5 bits and the next byte the distance back less 1.
    """
    i, o = 0, 0
    while i < len(packed):
        control = packed[i]
        i += 1
        if control < 32:
            length = control + 1
            if i + length > len(packed) or o + length > len(out):
                return -1
            out[o : o + length] = packed[i : i + length]
            i += length
        else:
            length = (control >> 5) + 2
            if i + (length == 9) >= len(packed):
                return -1
            if length == 9:
                length += packed[i]
                i += 1
            source = o - (((control & 31) << 8) | packed[i]) - 1
            i += 1
            if source < 0 or o + length > len(out):
                return -1
            for k in range(length):  # the source may overlap what is being written
                out[o + k] = out[source + k]
        o += length
    return o
