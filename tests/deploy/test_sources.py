import struct
import zlib

import numpy as np
import pytest

from hotice.deploy.clock import SimulatedClock
from hotice.deploy.link.protocol import LinkError
from hotice.deploy.messages.invalid import InvalidMessage
from hotice.deploy.sources import MemorySource, PoseSample, TagSample, UdpSender, UdpSource


def pose(number=7, **values):
    sample = {"measured_s": 1.5, "p_ML": np.array([1.0, -2.0, 0.5]), "quat_ML": np.array([0.0, 0.6, 0.8, 0.0])}
    return PoseSample(number=number, **{**sample, **values})


def tags(ids=(0, 3), number=1):
    corners = np.arange(8.0 * len(ids)).reshape(len(ids), 4, 2)
    return TagSample(number=number, measured_s=2.0, ids=np.array(ids, dtype=np.int64), corners_px=corners)


def test_a_pose_there_and_back():
    back = PoseSample.decode(pose().encode())
    assert (back.number, back.measured_s) == (7, 1.5)
    assert back.p_ML.tolist() == [1.0, -2.0, 0.5] and back.quat_ML.tolist() == [0.0, 0.6, 0.8, 0.0]


@pytest.mark.parametrize("ids", [(), (5,), tuple(range(16))])
def test_tags_there_and_back(ids):
    back = TagSample.decode(tags(ids).encode())
    assert back.ids.tolist() == list(ids)
    assert np.array_equal(back.corners_px, tags(ids).corners_px)


def test_a_program_without_hotice_writes_a_pose():
    body = struct.pack("<4sI8d", b"HTP1", 9, 12.5, 1.0, 2.0, 3.0, 1.0, 0.0, 0.0, 0.0)
    sample = PoseSample.decode(body + struct.pack("<I", zlib.crc32(body)))
    assert sample.number == 9 and sample.p_ML.tolist() == [1.0, 2.0, 3.0]


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (b"", "header"),
        (tags().encode(), "header"),
        (pose().encode()[:-1], "length"),
        (pose().encode() + b"\0", "length"),
        (pose().encode()[:-1] + b"\xff", "crc"),
        (pose(p_ML=np.array([np.nan, 0.0, 0.0])).encode(), "number"),
        (pose(p_ML=np.array([1e30, 0.0, 0.0])).encode(), "number"),
        (pose(quat_ML=np.zeros(4)).encode(), "number"),
        (pose(quat_ML=np.array([np.inf, 0.0, 0.0, 0.0])).encode(), "number"),
        (pose(measured_s=np.nan).encode(), "number"),
    ],
)
def test_what_does_not_open(data, reason):
    with pytest.raises(InvalidMessage) as error:
        PoseSample.decode(data)
    assert error.value.reason == reason


def test_tags_that_do_not_open():
    with pytest.raises(InvalidMessage, match="twice"):
        TagSample.decode(tags((4, 4)).encode())
    with pytest.raises(InvalidMessage, match="at most 16"):
        tags(tuple(range(17))).encode()


def test_damaged_samples_never_open(rng):
    for whole, decode in ((pose().encode(), PoseSample.decode), (tags().encode(), TagSample.decode)):
        for _ in range(500):
            raw = bytearray(whole)
            raw[int(rng.integers(len(raw)))] ^= 1 << int(rng.integers(8))
            with pytest.raises(InvalidMessage):
                decode(bytes(raw))


def test_the_newest_and_its_age():
    clock = SimulatedClock()
    source = MemorySource(clock, PoseSample.decode)
    assert source.newest() is None
    source.send(pose(1).encode())
    source.send(pose(2).encode())
    clock.sleep(0.3)
    newest = source.newest()
    assert (newest.sample.number, newest.number, newest.age_s) == (2, 2, pytest.approx(0.3))
    for late in (1, 2):
        source.send(pose(late).encode())
    source.send(b"rubbish")
    assert source.newest().age_s == pytest.approx(0.3)
    counts = source.counts()
    assert (counts.taken, counts.repeats, counts.backwards, counts.refused) == (2, 1, 1, {"header": 1})
    source.close()
    with pytest.raises(LinkError, match="closed"):
        source.newest()


def test_a_sender_that_restarts_is_heard_again():
    source = MemorySource(SimulatedClock(), PoseSample.decode)
    for number in (100, 0, 1, 2, 3, 4):
        source.send(pose(number).encode())
    assert source.newest().sample.number == 4


def test_over_udp():
    clock = SimulatedClock()
    source = UdpSource(0, PoseSample.decode, clock=clock)
    sender = UdpSender(source.port)
    for number in (1, 2, 3):
        sender.send(pose(number).encode())
    clock.sleep(0.5)
    # it may have come at once
    assert (source.newest().sample.number, source.newest().age_s) == (3, 0.5)
    clock.sleep(0.1)
    sender.send(pose(4).encode())
    clock.sleep(0.2)
    assert source.newest().age_s == pytest.approx(0.3)
    with pytest.raises(LinkError, match="cannot listen"):
        UdpSource(source.port, PoseSample.decode)
    with pytest.raises(LinkError, match="IPv4 address is needed"):
        UdpSender(source.port, host="::1")
    for end in (source, sender):
        end.close()
        end.close()
    with pytest.raises(LinkError, match="closed"):
        source.newest()
    with pytest.raises(LinkError, match="closed"):
        sender.send(b"")
