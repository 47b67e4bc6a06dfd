import numpy as np
import pytest

from hotice.deploy.messages.invalid import InvalidMessage
from hotice.deploy.messages.remote import KEYS, Sticks, connected, encode_remote, pressed, sticks
from hotice.errors import UnknownName


def test_bits_and_places_as_the_vendor_has_them():
    raw = np.zeros(40, np.uint8)
    raw[2], raw[3] = 0b0010_0000, 0b0000_0010  # L2 and B, the stop of public stacks
    raw[20:24] = np.frombuffer(np.float32(-0.5).tobytes(), np.uint8)
    assert pressed(raw) == {"L2", "B"} and sticks(raw) == Sticks(ly=-0.5)


def test_every_key_comes_back():
    for key in KEYS:
        assert pressed(encode_remote([key])) == {key}
    values = Sticks(lx=0.25, ly=-1.0, rx=0.5, ry=1.0, l2=0.125)
    assert sticks(encode_remote(KEYS, values)) == values and pressed(encode_remote(KEYS, values)) == set(KEYS)


def test_no_gamepad():
    assert not connected(encode_remote()) and connected(encode_remote(["A"]))


def test_a_broken_stick_hides_no_key():
    raw = encode_remote(["select"], Sticks(rx=np.nan))
    with pytest.raises(InvalidMessage, match="rx is nan"):
        sticks(raw)
    assert pressed(raw) == {"select"}


def test_an_unknown_key():
    with pytest.raises(UnknownName, match="known are A, B"):
        encode_remote(["Z"])
