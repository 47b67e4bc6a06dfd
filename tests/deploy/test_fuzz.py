"""Damaged messages, and what opening them may do: refuse by `InvalidMessage`, nothing else."""

import functools

import numpy as np
import pytest

from hotice.deploy.messages.cdr import encode
from hotice.deploy.messages.checks import open_bms, open_imu, open_low_cmd, open_low_state, seal
from hotice.deploy.messages.hg import BMS_STATE, IMU_STATE, LOW_CMD, LOW_STATE, MACHINES
from hotice.deploy.messages.invalid import InvalidMessage
from hotice.deploy.messages.rpc import Request, Response
from tests.deploy.messages_fixture import filled, low_cmd, low_state

DAMAGES = ("cut", "longer", "header", "bits", "noise", "crc", "number", "mode")
BAD_NUMBERS = (np.nan, np.inf, -np.inf, 1e30, -1e7)


@functools.cache
def read_numbers(struct):
    """Places of the float numbers that somebody reads."""
    return [p.offset for p in struct.primitives if p.kind == "f32" and (p.path[0] != "motor_state" or p.path[1] < 29)]


def damaged(kind, struct, record, rng):
    """The record as a message with one kind of damage, which is no message any more."""
    data = bytearray(seal(struct, record))
    if kind == "cut":
        return bytes(data[: rng.integers(len(data))])
    if kind == "longer":
        return bytes(data) + rng.bytes(int(rng.integers(1, 3000)))
    if kind == "header":
        place, value = rng.integers(3), rng.integers(1, 256)
        data[place] = (data[place] + value) % 256
    if kind == "bits":
        places = 4 + np.flatnonzero(struct.wire_places < struct.dtype.itemsize)
        for place in rng.choice(places, int(rng.integers(1, 20)), replace=False):
            data[place] ^= int(rng.integers(1, 256))
    if kind == "noise":
        return bytes(data[:4]) + rng.bytes(len(data) - 4)
    if kind == "crc":
        data[-4:] = rng.bytes(4)
    if kind == "number":
        raw = np.frombuffer(record.tobytes(), np.uint8).copy()
        place = rng.choice(read_numbers(struct))
        raw[place : place + 4] = np.frombuffer(np.float32(rng.choice(BAD_NUMBERS)).tobytes(), np.uint8)
        return seal(struct, raw.view(struct.dtype).reshape(()))
    if kind == "mode":
        name, legal = (("mode_machine", MACHINES), ("mode_pr", (0, 1)))[rng.integers(2)]
        record[name] = rng.choice([v for v in range(256) if v not in legal])
        return seal(struct, record)
    return bytes(data)


@pytest.mark.parametrize(
    ("struct", "fresh", "opened"),
    [(LOW_STATE, low_state, open_low_state), (LOW_CMD, low_cmd, open_low_cmd)],
    ids=["LowState", "LowCmd"],
)
def test_no_damaged_message_opens(struct, fresh, opened, rng):
    records, reasons = [fresh(rng) for _ in range(20)], set()
    for i in range(1000):
        data = damaged(DAMAGES[i % len(DAMAGES)], struct, records[rng.integers(20)].copy(), rng)
        with pytest.raises(InvalidMessage) as error:
            opened(data)
        reasons.add(error.value.reason)
    assert reasons == {"length", "header", "crc", "number", "mode"}


def test_motors_of_a_command_are_on_or_off(rng):
    command = low_cmd(rng)
    command["motor_cmd"]["mode"][31] = 2
    with pytest.raises(InvalidMessage, match="motor of mode 2"):
        open_low_cmd(seal(LOW_CMD, command))


def test_an_imu_that_has_not_begun_is_refused(rng):
    state = low_state(rng)
    state["imu_state"]["quaternion"] = 0.0
    with pytest.raises(InvalidMessage, match="length 0"):
        open_low_state(seal(LOW_STATE, state))


def test_unused_slots_of_a_state_may_hold_anything(rng):
    state = low_state(rng)
    state["motor_state"]["q"][29:] = np.nan
    open_low_state(seal(LOW_STATE, state))


def test_messages_without_a_checksum(rng):
    imu, battery = filled(IMU_STATE, rng), filled(BMS_STATE, rng)
    imu["quaternion"], battery["soc"] = (0.0, 1.0, 0.0, 0.0), 87
    assert open_imu(encode(IMU_STATE, imu))["rpy"].tobytes() == imu["rpy"].tobytes()
    assert open_bms(encode(BMS_STATE, battery))["soc"] == 87
    imu["gyroscope"][1], battery["soc"] = np.nan, 101
    with pytest.raises(InvalidMessage, match="gyroscope.1 is nan"):
        open_imu(encode(IMU_STATE, imu))
    with pytest.raises(InvalidMessage, match="soc = 101"):
        open_bms(encode(BMS_STATE, battery))


@pytest.mark.parametrize("kind", [Request, Response])
def test_calls_and_answers_open_or_are_refused(kind, rng):
    """They have no checksum: damage may leave another possible text, but raises nothing else."""
    fields = dict(id=2**40 + 1, api_id=1001) | (
        dict(parameter='{"name":"é"}') if kind is Request else dict(code=-3, data='{"form":"0","name":"ai"}')
    )
    message = kind(**fields)
    data = message.encode()
    assert kind.decode(data) == message
    refused = 0
    for _ in range(1000):
        broken = bytearray(data[: rng.integers(len(data) + 1)] if rng.random() < 0.5 else data)
        for place in rng.integers(0, max(len(broken), 1), 3) if broken else ():
            broken[place] = rng.integers(256)
        try:
            kind.decode(bytes(broken))
        except InvalidMessage:
            refused += 1
    assert refused > 500
