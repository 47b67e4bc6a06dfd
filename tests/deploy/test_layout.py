import numpy as np
import pytest

from hotice.deploy.messages import hg
from hotice.deploy.messages.cdr import HEADER, decode, encode
from hotice.deploy.messages.invalid import InvalidMessage
from hotice.model import g1
from tests.deploy.messages_fixture import filled

SIZES = {  # C struct, CDR body [bytes]; the vendor's headers and the generic serializer
    hg.MOTOR_CMD: (28, 28),
    hg.LOW_CMD: (1004, 1000),
    hg.IMU_STATE: (56, 54),
    hg.MOTOR_STATE: (56, 56),
    hg.LOW_STATE: (2092, 2088),
    hg.BMS_STATE: (164, 164),
}


@pytest.mark.parametrize("struct", SIZES, ids=lambda s: s.name)
def test_sizes(struct):
    assert (struct.dtype.itemsize, len(struct.wire_places)) == SIZES[struct]


def wire_offset(struct, *path):
    (place,) = (p.offset for p in struct.primitives if p.path == path)
    return int(np.flatnonzero(struct.wire_places == place)[0])


def test_places_of_a_command_on_the_wire():
    at = {name: wire_offset(hg.LOW_CMD, name) for name in ("mode_pr", "mode_machine", "crc")}
    assert at == {"mode_pr": 0, "mode_machine": 1, "crc": 996}
    assert wire_offset(hg.LOW_CMD, "reserve", 0) == 980
    modes = [wire_offset(hg.LOW_CMD, "motor_cmd", i, "mode") for i in range(35)]
    positions = [wire_offset(hg.LOW_CMD, "motor_cmd", i, "q") for i in range(35)]
    assert modes == [2, *(28 * i for i in range(1, 35))] and positions == [28 * i + 4 for i in range(35)]


def test_places_of_a_state_on_the_wire():
    assert [
        wire_offset(hg.LOW_STATE, *path) for path in (("version", 0), ("mode_pr",), ("mode_machine",), ("tick",))
    ] == [
        0,
        8,
        9,
        12,
    ]
    imu = [("quaternion", 0), ("gyroscope", 0), ("accelerometer", 0), ("rpy", 0), ("temperature",)]
    assert [wire_offset(hg.LOW_STATE, "imu_state", *field) for field in imu] == [16, 32, 44, 56, 68]
    modes = [wire_offset(hg.LOW_STATE, "motor_state", i, "mode") for i in range(35)]
    positions = [wire_offset(hg.LOW_STATE, "motor_state", i, "q") for i in range(35)]
    assert modes == [70, *(68 + 56 * i for i in range(1, 35))] and positions == [72 + 56 * i for i in range(35)]
    ends = [("wireless_remote", 0), ("reserve", 0), ("crc",)]
    assert [wire_offset(hg.LOW_STATE, *path) for path in ends] == [2028, 2068, 2084]


@pytest.mark.parametrize("struct", SIZES, ids=lambda s: s.name)
def test_a_record_comes_back_from_the_wire(struct, rng):
    for _ in range(20):
        clean = filled(struct, rng)
        data = encode(struct, clean)
        assert data[:4] == HEADER and len(data) % 4 == 0
        assert decode(struct, data).tobytes() == clean.tobytes()


def test_what_padding_holds_is_neither_sent_nor_read(rng):
    dirty = filled(hg.LOW_STATE, rng, dirty=True)
    clean = decode(hg.LOW_STATE, encode(hg.LOW_STATE, dirty))
    assert clean.tobytes() != dirty.tobytes() and encode(hg.LOW_STATE, clean) == encode(hg.LOW_STATE, dirty)
    data = bytearray(encode(hg.LOW_STATE, clean))
    padding = 4 + np.flatnonzero(hg.LOW_STATE.wire_places == hg.LOW_STATE.dtype.itemsize)
    for place in padding:
        data[place] = 0xFF
    assert len(padding) == 2 + 1 + 34 * 3 and decode(hg.LOW_STATE, bytes(data)).tobytes() == clean.tobytes()


def test_a_decoded_record_cannot_be_written(rng):
    state = decode(hg.LOW_STATE, encode(hg.LOW_STATE, filled(hg.LOW_STATE, rng)))
    with pytest.raises(ValueError):
        state["tick"] = 3
    with pytest.raises(ValueError):
        state["motor_state"]["q"].flags.writeable = True


@pytest.mark.parametrize(
    ("damage", "reason"),
    [
        (lambda d: b"", "length"),
        (lambda d: d[:3], "length"),
        (lambda d: d[:-1], "length"),
        (lambda d: d + b"\0", "length"),
        (lambda d: b"\0\0" + d[2:], "header"),  # big-endian
        (lambda d: b"\0\7" + d[2:], "header"),  # the second version of CDR
    ],
)
def test_other_lengths_and_headers_are_refused(damage, reason, rng):
    with pytest.raises(InvalidMessage) as error:
        decode(hg.LOW_CMD, damage(encode(hg.LOW_CMD, filled(hg.LOW_CMD, rng))))
    assert error.value.reason == reason


def test_the_joints_fill_the_first_slots():
    """Left leg, right leg, waist, left arm, right arm: the vendor's order of the 29 joints."""
    assert len(g1.ALL_JOINTS) == hg.JOINTS.stop
    assert [g1.ALL_JOINTS[i] for i in (0, 3, 6, 11, 12, 13, 14, 15, 22, 28)] == [
        "left_hip_pitch_joint",
        "left_knee_joint",
        "right_hip_pitch_joint",
        "right_ankle_roll_joint",
        "waist_yaw_joint",
        "waist_roll_joint",
        "waist_pitch_joint",
        "left_shoulder_pitch_joint",
        "right_shoulder_pitch_joint",
        "right_wrist_yaw_joint",
    ]
