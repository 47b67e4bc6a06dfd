"""Messages opened and closed: bytes become a record only with the right length, checksum and possible numbers.

Every `open_…` takes bytes as they came and returns a read-only record (), or raises `InvalidMessage` and nothing else.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from hotice.deploy.messages.cdr import HEADER, decode, encode
from hotice.deploy.messages.crc import record_crc
from hotice.deploy.messages.hg import ANKLES_AB, BMS_STATE, IMU_STATE, JOINTS, LOW_CMD, LOW_STATE, MACHINES, PITCH_ROLL
from hotice.deploy.messages.invalid import InvalidMessage
from hotice.deploy.messages.structs import Primitive, Struct

LARGEST = 1e6
"""No number of these messages, in its unit, is as large."""
QUATERNION_LENGTH = (0.9, 1.1)
"""An attitude's length; 0 is what an IMU sends that has not begun."""


@cache
def numbers(struct: Struct) -> tuple[Primitive, ...]:
    """The float numbers of a message that somebody reads; unused slots of a state may hold anything."""
    floats = (p for p in struct.primitives if p.kind == "f32")
    return tuple(p for p in floats if not (p.path[0] == "motor_state" and int(p.path[1]) >= JOINTS.stop))


def seal(struct: Struct, record: np.ndarray) -> bytes:
    """A LowCmd or LowState as bytes on the wire with its checksum in place; the record's own `crc` is left alone."""
    message = bytearray(encode(struct, record))
    # the last field; a copy of the record to put it in would take longer than all else
    end = len(HEADER) + len(struct.wire_places)
    message[end - 4 : end] = record_crc(struct, record).to_bytes(4, "little")
    return bytes(message)


def open_low_state(data: bytes) -> np.ndarray:
    """A LowState with the right checksum, possible numbers in IMU and the 29 joints, and a machine that exists."""
    state = _open_sealed(LOW_STATE, data)
    _check_numbers(LOW_STATE, state)
    _check_quaternion(LOW_STATE, state["imu_state"]["quaternion"])
    _check_modes(LOW_STATE, state)
    return state


def open_low_cmd(data: bytes) -> np.ndarray:
    """A LowCmd with the right checksum, possible numbers in every slot, and modes that exist (the robot's end)."""
    command = _open_sealed(LOW_CMD, data)
    _check_numbers(LOW_CMD, command)
    _check_modes(LOW_CMD, command)
    largest = int(command["motor_cmd"]["mode"].max())
    if largest > 1:
        raise InvalidMessage("mode", f"LowCmd_ has a motor of mode {largest}: 0 (off) and 1 (on) exist")
    return command


def open_imu(data: bytes) -> np.ndarray:
    """An IMUState of possible numbers; it has no checksum of its own."""
    imu = decode(IMU_STATE, data)
    _check_numbers(IMU_STATE, imu)
    _check_quaternion(IMU_STATE, imu["quaternion"])
    return imu


def open_bms(data: bytes) -> np.ndarray:
    """A BmsState with a charge of at most 100 %; it has no checksum of its own."""
    battery = decode(BMS_STATE, data)
    if battery["soc"] > 100:
        raise InvalidMessage("number", f"BmsState_ says soc = {battery['soc']} %: 0 to 100 is possible")
    return battery


def _open_sealed(struct: Struct, data: bytes) -> np.ndarray:
    record = decode(struct, data)
    right, came = record_crc(struct, record), int(record["crc"])
    if came != right:
        raise InvalidMessage("crc", f"{struct.name} came with checksum {came:#010x}, its bytes have {right:#010x}")
    return record


def _check_numbers(struct: Struct, record: np.ndarray) -> None:
    values = np.frombuffer(record.tobytes(), "<f4")[_words(struct)]
    good = np.abs(values) <= LARGEST
    if not good.all():
        i = int(np.argmin(good))
        field = ".".join(map(str, numbers(struct)[i].path))
        raise InvalidMessage(
            "number", f"{struct.name}: {field} is {values[i]:g}: finite and up to {LARGEST:g} is possible"
        )


@cache
def _words(struct: Struct) -> np.ndarray:
    return np.array([p.offset // 4 for p in numbers(struct)])


def _check_quaternion(struct: Struct, quaternion: np.ndarray) -> None:
    length = float(np.sqrt(quaternion @ quaternion))
    low, high = QUATERNION_LENGTH
    if not low <= length <= high:
        raise InvalidMessage(
            "number", f"{struct.name} has a quaternion of length {length:.3g}: {low} to {high} is possible"
        )


def _check_modes(struct: Struct, record: np.ndarray) -> None:
    machine, pr = int(record["mode_machine"]), int(record["mode_pr"])
    if machine not in MACHINES:
        raise InvalidMessage("mode", f"{struct.name} has mode_machine {machine}: known are {sorted(MACHINES)}")
    if pr not in (PITCH_ROLL, ANKLES_AB):
        raise InvalidMessage("mode", f"{struct.name} has mode_pr {pr}: {PITCH_ROLL} and {ANKLES_AB} exist")
