"""Samples of sources as fixed records: to bytes and back, with a checksum; never pickle, no text.

    magic 4 bytes, number u32, measured_s f64, contents, crc u32

Little-endian, no padding; the checksum is zlib's CRC-32 of all bytes before it. A program without hotice writes them
with `struct.pack`: a pose as "<4sI8d" and "<I".
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hotice.deploy.messages.invalid import InvalidMessage

Array = NDArray[np.float64]
HEAD = [("magic", "S4"), ("number", "<u4"), ("measured_s", "<f8")]
TAIL = [("crc", "<u4")]
POSE_MAGIC, TAGS_MAGIC = b"HTP1", b"HTT1"
MOST_TAGS = 16
POSE = np.dtype([*HEAD, ("position", "<f8", 3), ("quaternion", "<f8", 4), *TAIL])
TAGS = np.dtype([*HEAD, ("count", "<u4"), ("ids", "<u4", MOST_TAGS), ("corners", "<f8", (MOST_TAGS, 4, 2)), *TAIL])
FARTHEST = 1e6
"""Numbers beyond this [m, px, s·10⁶] are none."""
QUATERNION_LENGTH = (0.9, 1.1)


@dataclass(frozen=True, kw_only=True, eq=False)
class PoseSample:
    """A pose of localization: the lidar's IMU L in the map M, as FAST-LIO reports it (`hotice.deploy.frames`)."""

    number: int
    """Of the sender, one more each time, modulo 2**32."""
    measured_s: float
    """When it was measured, on the sender's clock [s]."""
    p_ML: Array
    """(3,) in the map's unit."""
    quat_ML: Array
    """(4,) wxyz, unit."""

    def encode(self) -> bytes:
        """Its bytes."""
        record = _headed(POSE, POSE_MAGIC, self.number, self.measured_s)
        record["position"], record["quaternion"] = self.p_ML, self.quat_ML
        return _sealed(record)

    @classmethod
    def decode(cls, data: bytes) -> PoseSample:
        """Raises `InvalidMessage`."""
        record = _opened("pose", POSE, POSE_MAGIC, data)
        position, quat = record["position"].copy(), record["quaternion"].copy()
        _check("pose", "a number", position)
        length = float(np.sqrt(quat @ quat))
        low, high = QUATERNION_LENGTH
        if not low <= length <= high:
            raise InvalidMessage("number", f"pose has a quaternion of length {length:.3g}: {low} to {high} is possible")
        return cls(
            number=int(record["number"]),
            measured_s=float(record["measured_s"]),
            p_ML=position,
            quat_ML=quat / length,
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class TagSample:
    """Tags found in one picture; none is a picture without any."""

    number: int
    measured_s: float
    """When the picture was taken, on the sender's clock [s]."""
    ids: NDArray[np.int64]
    """(T,), each once."""
    corners_px: Array
    """(T, 4, 2), see `TagBundle.corners_O` for the order."""

    def encode(self) -> bytes:
        """Its bytes. Raises `InvalidMessage` for more than `MOST_TAGS` tags."""
        count = len(self.ids)
        if count > MOST_TAGS:
            raise InvalidMessage("length", f"{count} tags: at most {MOST_TAGS} fit in a sample")
        record = _headed(TAGS, TAGS_MAGIC, self.number, self.measured_s)
        record["count"] = count
        record["ids"][:count], record["corners"][:count] = self.ids, self.corners_px
        return _sealed(record)

    @classmethod
    def decode(cls, data: bytes) -> TagSample:
        """Raises `InvalidMessage`."""
        record = _opened("tags", TAGS, TAGS_MAGIC, data)
        count = int(record["count"])
        if count > MOST_TAGS:
            raise InvalidMessage("number", f"tags: {count} in one sample, 0 to {MOST_TAGS} are possible")
        ids, corners = record["ids"][:count].astype(np.int64), record["corners"][:count].copy()
        if len(set(ids.tolist())) < count:
            raise InvalidMessage("number", f"tags: an id came twice in {ids.tolist()}")
        _check("tags", "a corner", corners)
        return cls(number=int(record["number"]), measured_s=float(record["measured_s"]), ids=ids, corners_px=corners)


def _headed(dtype: np.dtype, magic: bytes, number: int, measured_s: float) -> np.ndarray:
    record = np.zeros((), dtype)
    record["magic"], record["number"], record["measured_s"] = magic, number % (1 << 32), measured_s
    return record


def _sealed(record: np.ndarray) -> bytes:
    body = record.tobytes()[:-4]
    return body + zlib.crc32(body).to_bytes(4, "little")


def _opened(name: str, dtype: np.dtype, magic: bytes, data: bytes) -> np.ndarray:
    if data[:4] != magic:
        raise InvalidMessage("header", f"{name} begins with {data[:4]!r}: {magic!r} is needed")
    if len(data) != dtype.itemsize:
        raise InvalidMessage("length", f"{name} has {len(data)} bytes: {dtype.itemsize} are needed")
    record = np.frombuffer(data, dtype).reshape(())
    right, came = zlib.crc32(data[:-4]), int(record["crc"])
    if came != right:
        raise InvalidMessage("crc", f"{name} came with checksum {came:#010x}, its bytes have {right:#010x}")
    _check(name, "its time", 1e-6 * record["measured_s"])
    return record


def _check(name: str, what: str, values: np.ndarray) -> None:
    if not (np.abs(values) <= FARTHEST).all():
        raise InvalidMessage("number", f"{name}: {what} is not finite or beyond {FARTHEST:g}")
