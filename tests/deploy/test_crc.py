import numpy as np
import pytest

from hotice.deploy.messages.checks import open_low_cmd, open_low_state, seal
from hotice.deploy.messages.crc import crc32_mpeg2, record_crc
from hotice.deploy.messages.hg import JOINTS, LOW_CMD, LOW_STATE
from hotice.deploy.messages.invalid import InvalidMessage
from tests.deploy.messages_fixture import filled, low_cmd, low_state


def bit_by_bit(words):
    """The definition: each word from its highest bit."""
    crc = 0xFFFFFFFF
    for word in words:
        for bit in range(31, -1, -1):
            top = (crc >> 31) ^ (int(word) >> bit & 1)
            crc = (crc << 1 & 0xFFFFFFFF) ^ (0x04C11DB7 if top else 0)
    return crc


def two_joints():
    """Public in strands-labs/robots, pull request 2767."""
    command = LOW_CMD.zeros()
    for slot, q in ((3, 0.5), (15, 0.2)):
        for name, value in (("q", q), ("kp", 25.0), ("kd", 0.5)):
            command["motor_cmd"][name][slot] = value
    return command


def all_joints():
    """Equal to the vendor's own function."""
    command = LOW_CMD.zeros()
    command["mode_machine"] = 5
    motors = command["motor_cmd"]
    motors["mode"][JOINTS], motors["kp"][JOINTS], motors["kd"][JOINTS] = 1, 40.0, 1.0
    motors["q"][JOINTS] = 0.1 * np.arange(29)
    return command


def test_the_check_value_of_the_algorithm():
    assert crc32_mpeg2(b"123456789") == 0x0376E6E7


@pytest.mark.parametrize(
    ("struct", "record", "crc"),
    [
        (LOW_CMD, LOW_CMD.zeros(), 4262932383),
        (LOW_STATE, LOW_STATE.zeros(), 3595284554),
        (LOW_CMD, two_joints(), 4030115248),
        (LOW_CMD, all_joints(), 763542649),
    ],
)
def test_known_messages(struct, record, crc):
    assert record_crc(struct, record) == crc


@pytest.mark.parametrize("struct", [LOW_CMD, LOW_STATE], ids=lambda s: s.name)
def test_equal_to_the_definition(struct, rng):
    for _ in range(3):
        record = filled(struct, rng)
        words = np.frombuffer(record.tobytes(), "<u4")[:-1]
        assert record_crc(struct, record) == bit_by_bit(words)


def test_padding_counts_as_zero(rng):
    dirty = filled(LOW_CMD, rng, dirty=True)
    clean = LOW_CMD.zeros()
    for name in LOW_CMD.dtype.names:
        if name != "motor_cmd":
            clean[name] = dirty[name]
    for name in dirty["motor_cmd"].dtype.names:
        clean["motor_cmd"][name] = dirty["motor_cmd"][name]
    assert dirty.tobytes() != clean.tobytes() and record_crc(LOW_CMD, dirty) == record_crc(LOW_CMD, clean)


def test_sealed_messages_open(rng):
    state, command = low_state(rng), low_cmd(rng)
    assert open_low_state(seal(LOW_STATE, state))["motor_state"]["q"].tobytes() == state["motor_state"]["q"].tobytes()
    assert open_low_cmd(seal(LOW_CMD, command))["motor_cmd"]["q"].tobytes() == command["motor_cmd"]["q"].tobytes()


def test_the_checksum_covers_every_number(rng):
    """One flipped bit anywhere but in padding is noticed; at each byte of a command in turn."""
    message = seal(LOW_CMD, low_cmd(rng))
    for place in 4 + np.flatnonzero(LOW_CMD.wire_places < LOW_CMD.dtype.itemsize):
        data = bytearray(message)
        data[place] ^= 1 << int(rng.integers(8))
        with pytest.raises(InvalidMessage) as error:
            open_low_cmd(bytes(data))
        assert error.value.reason == "crc"
