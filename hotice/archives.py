"""NumPy archives (.npz) that somebody else may have made: arrays and nothing else, within bounds."""

from __future__ import annotations

import io
import lzma
import struct
import tokenize
import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from hotice.errors import InputError
from hotice.files import read_bytes

_DAMAGED = (
    *(OSError, EOFError, ValueError, KeyError, OverflowError, MemoryError, RuntimeError, NotImplementedError),
    *(struct.error, tokenize.TokenError, zlib.error, lzma.LZMAError, zipfile.BadZipFile, zipfile.LargeZipFile),
)
"""What zipfile and NumPy raise for bytes that are no archive, are cut short, changed, packed in another way or locked,
and for arrays that say they are larger than any memory."""


def read_arrays(path: str | Path, max_bytes: int, max_unpacked: int) -> dict[str, Any]:
    """Arrays of an archive by name; nothing in it is executed.

    Raises:
        InputError: the file cannot be read (`read_bytes`), is no archive of arrays, or would unpack to more bytes.
    """
    content = read_bytes(path, max_bytes)
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as packed:
            unpacked = sum(entry.file_size for entry in packed.infolist())
        if unpacked <= max_unpacked:
            with np.load(io.BytesIO(content), allow_pickle=False) as archive:
                return {name: np.asarray(archive[name]) for name in archive.files}
    except _DAMAGED as error:
        raise InputError(f"{path}: is no archive of arrays: {error}") from None
    raise InputError(f"{path}: unpacks to more than {max_unpacked // 2**20} MiB")
