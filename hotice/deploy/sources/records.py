"""Samples of sources as fixed records: to bytes and back, with a checksum; never pickle, no text.

    magic 4 bytes, number u32, measured_s f64, contents, crc u32

Little-endian, no padding; the checksum is zlib's CRC-32 of all bytes before it. A program without hotice writes them
with `struct.pack`: a pose as "<4sI8d" and "<I".
"""

from __future__ import annotations

import zlib
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hotice.deploy.messages.invalid import InvalidMessage
from hotice.model.scene import MAX_MOVING

Array = NDArray[np.float64]
HEAD = [("magic", "S4"), ("number", "<u4"), ("measured_s", "<f8")]
TAIL = [("crc", "<u4")]
POSE_MAGIC, TAGS_MAGIC, MOVERS_MAGIC = b"HTP1", b"HTT1", b"HTM1"
MOST_TAGS = 16
POSE = np.dtype([*HEAD, ("position", "<f8", 3), ("quaternion", "<f8", 4), *TAIL])
TAGS = np.dtype([*HEAD, ("count", "<u4"), ("ids", "<u4", MOST_TAGS), ("corners", "<f8", (MOST_TAGS, 4, 2)), *TAIL])
MOVERS = np.dtype([*HEAD, ("scene", "<u4"), ("count", "<u4"), ("poses", "<f8", (MAX_MOVING, 7)), *TAIL])
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
        position = record["position"].copy()
        _check("pose", "a number", position)
        quat = _unit("pose", record["quaternion"].copy())
        return cls(number=int(record["number"]), measured_s=float(record["measured_s"]), p_ML=position, quat_ML=quat)


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


@dataclass(frozen=True, kw_only=True, eq=False)
class MoverSample:
    """Poses of all obstacles of a scene that move, in their order there, in the map M of localization."""

    number: int
    measured_s: float
    """When they were seen, on the sender's clock [s]."""
    scene: int
    """Whose they are: `scene_mark` of the obstacles that move."""
    poses_M: Array
    """(m, 7) position in the map's unit, and quaternion wxyz, unit."""

    def encode(self) -> bytes:
        """Its bytes. Raises `InvalidMessage` for more than `MAX_MOVING` poses."""
        count = len(self.poses_M)
        if count > MAX_MOVING:
            raise InvalidMessage("length", f"{count} poses: at most {MAX_MOVING} fit in a sample")
        record = _headed(MOVERS, MOVERS_MAGIC, self.number, self.measured_s)
        record["scene"], record["count"] = self.scene, count
        record["poses"][:count] = self.poses_M
        return _sealed(record)

    @classmethod
    def decode(cls, data: bytes) -> MoverSample:
        """Raises `InvalidMessage`."""
        record = _opened("movers", MOVERS, MOVERS_MAGIC, data)
        count = int(record["count"])
        if count > MAX_MOVING:
            raise InvalidMessage("number", f"movers: {count} in one sample, 0 to {MAX_MOVING} are possible")
        poses = record["poses"][:count].copy()
        _check("movers", "a position", poses[:, :3])
        for pose in poses:
            pose[3:] = _unit("movers", pose[3:])
        return cls(
            number=int(record["number"]),
            measured_s=float(record["measured_s"]),
            scene=int(record["scene"]),
            poses_M=poses,
        )


def scene_mark(names: Iterable[str]) -> int:
    """What a sample of movers is marked by: CRC-32 of their names (UTF-8), each ended by a zero byte."""
    return zlib.crc32(b"".join(name.encode() + b"\0" for name in names))


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


def _unit(name: str, quat: Array) -> Array:
    """A quaternion (4,) that is one, made a unit one."""
    length = float(np.sqrt(quat @ quat))
    low, high = QUATERNION_LENGTH
    if not low <= length <= high:
        raise InvalidMessage("number", f"{name} has a quaternion of length {length:.3g}: {low} to {high} is possible")
    return quat / length


def _check(name: str, what: str, values: np.ndarray) -> None:
    if not (np.abs(values) <= FARTHEST).all():
        raise InvalidMessage("number", f"{name}: {what} is not finite or beyond {FARTHEST:g}")
