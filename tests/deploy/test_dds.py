"""The link over DDS: types and bytes against Cyclone's own, two processes over loopback, never another interface."""

import contextlib
import itertools
import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from hotice.deploy.clock import MonotonicClock, SimulatedClock
from hotice.deploy.command import LIMITS, CheckedCommand
from hotice.deploy.link.protocol import LinkError
from hotice.deploy.link.publishers import SecondPublisher, check_sole_publisher
from hotice.deploy.messages import hg
from hotice.deploy.messages.cdr import decode, encode
from hotice.deploy.messages.rpc import Request, Response
from hotice.deploy.switcher import QUESTIONS, SERVICE, ServiceError, active_controller, leave_high_level
from hotice.errors import InvalidConfig
from tests.deploy.messages_fixture import filled, low_state

pytest.importorskip("cyclonedds", reason="the link over DDS needs the extra `deploy`")

from hotice.deploy.dds import idl_types  # noqa: E402
from hotice.deploy.dds.link import DdsLink, DdsRobot  # noqa: E402
from hotice.deploy.dds.node import LOOPBACK, DdsNode, configuration  # noqa: E402
from hotice.deploy.dds.service import DdsServer, DdsService  # noqa: E402
from tests.deploy.dds_peer import MACHINE  # noqa: E402

ROBOT_HASHES = {  # of the vendor's C++ headers
    hg.IMU_STATE: "fc687176651206558473df442280",
    hg.MOTOR_CMD: "827f55de9b9de38c62bacd1e56c9",
    hg.MOTOR_STATE: "7cc584ed940b8f3018f18de0ed24",
    hg.LOW_CMD: "6569fc15f0d47aa8600b9e91fbbc",
    hg.LOW_STATE: "2f38296b52aa0230b92d378b1e39",
}
DOMAINS = itertools.count(20 + 8 * (os.getpid() % 25))
"""One for each test: ten participants fit into one, and other tests may run on this machine."""
LONG_S = 30.0
REPOSITORY = Path(__file__).parents[2]
"""Where a peer finds `tests`."""


def type_hash(data_type):
    return bytes(data_type.__idl__.get_type_info().minimal.typeid_with_size.type_id.value).hex()


@pytest.mark.parametrize("struct", ROBOT_HASHES, ids=lambda s: s.name)
def test_types_are_the_robots(struct):
    """Names of types aside, this holds order, kind and count of every field, `byte` for 8 bits included."""
    assert type_hash(idl_types.plain_type(struct)) == type_hash(idl_types.packed_type(struct)) == ROBOT_HASHES[struct]


def test_the_type_that_kills_other_machines_has_another_hash():
    from cyclonedds.idl import make_idl_struct
    from cyclonedds.idl.types import float32, uint8, uint32

    fields = dict(mode=uint8) | dict.fromkeys(("q", "dq", "tau", "kp", "kd"), float32) | dict(reserve=uint32)
    wrong = make_idl_struct("MotorCmd_", "unitree_hg.msg.dds_.MotorCmd_", fields)
    assert type_hash(wrong) != ROBOT_HASHES[hg.MOTOR_CMD]


@pytest.mark.parametrize("struct", ROBOT_HASHES, ids=lambda s: s.name)
def test_type_names(struct):
    assert idl_types.packed_type(struct).__idl_typename__ == f"unitree_hg.msg.dds_.{struct.name}"


def as_sample(struct, record):
    """The record as Cyclone's own dataclasses."""
    values = {}
    for field in struct.fields:
        value = record[field.name]
        if not hasattr(field.kind, "fields"):
            values[field.name] = value.tolist()
        elif field.count == 1:
            values[field.name] = as_sample(field.kind, value)
        else:
            values[field.name] = [as_sample(field.kind, part) for part in value]
    return idl_types.plain_type(struct)(**values)


@pytest.mark.parametrize("struct", [*ROBOT_HASHES, hg.BMS_STATE], ids=lambda s: s.name)
def test_bytes_are_those_of_the_generic_serializer(struct, rng):
    for _ in range(5):
        record = filled(struct, rng)
        theirs = as_sample(struct, record).serialize(use_version_2=False)
        theirs += b"\0" * (-len(theirs) % 4)
        assert encode(struct, record) == theirs and decode(struct, theirs).tobytes() == record.tobytes()


@pytest.mark.parametrize("text", ["", "{}", '{"name":"é"}'])
def test_calls_are_those_of_the_generic_serializer(text):
    theirs = idl_types.request_type(packed=False).deserialize(Request(id=7, api_id=1001, parameter=text).encode())
    assert (theirs.header.identity.id, theirs.header.identity.api_id, theirs.parameter) == (7, 1001, text)
    assert theirs.header.lease.id == theirs.header.policy.priority == 0 and not theirs.header.policy.noreply
    assert Request.decode(theirs.serialize(use_version_2=False)) == Request(id=7, api_id=1001, parameter=text)
    answer = idl_types.response_type(packed=False).deserialize(Response(id=-7, api_id=3, code=-1, data=text).encode())
    assert (answer.header.identity.id, answer.header.status.code, answer.data) == (-7, -1, text)
    answer.binary = [1, 2, 3]
    assert Response.decode(answer.serialize(use_version_2=False)) == Response(id=-7, api_id=3, code=-1, data=text)


def test_the_interface_is_named():
    with pytest.raises(LinkError, match="no network interface 'nosuch0': this machine has .*lo"):
        DdsNode(domain=1, interface="nosuch0")
    for domain in (-1, 231, True, "0"):
        with pytest.raises(LinkError, match="0 to 230"):
            DdsNode(domain=domain, interface=LOOPBACK)
    assert 'NetworkInterface name="enp3s0"' in configuration("enp3s0")
    assert "<AllowMulticast>false" in configuration("lo") and "localhost" not in configuration("enp3s0")


def test_one_node_per_domain_and_process():
    domain = next(DOMAINS)
    with DdsNode(domain=domain, interface=LOOPBACK), pytest.raises(LinkError, match=f"domain {domain} on lo"):
        DdsNode(domain=domain, interface=LOOPBACK)
    with DdsNode(domain=domain, interface=LOOPBACK) as node:
        link = DdsLink(node)
        link.close()
        with pytest.raises(LinkError, match="closed"):
            link.state()


def test_one_link_per_node():
    with DdsNode(domain=next(DOMAINS), interface=LOOPBACK) as node:
        first = DdsLink(node)
        with pytest.raises(LinkError, match="has a link already.*close the first"):
            DdsLink(node)
        first.close()
        second = DdsLink(node)
        first.close()  # a second time: does not free the place of the other
        with pytest.raises(LinkError, match="has a link already"):
            DdsLink(node)
        second.close()
    with pytest.raises(LinkError, match="node is closed"):
        DdsLink(node)


@contextlib.contextmanager
def peer(role, domain):
    command = [sys.executable, "-m", "tests.deploy.dds_peer", role, str(domain)]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    with subprocess.Popen(command, text=True, cwd=REPOSITORY, **pipes) as process:
        try:
            yield process
        finally:
            process.stdin.close()
            if process.wait(LONG_S) not in (0, -9):
                raise AssertionError(f"{role} ended with {process.returncode}")


@contextlib.contextmanager
def linked(domain):
    with DdsNode(domain=domain, interface=LOOPBACK) as node:
        link = DdsLink(node)
        yield node, link
        link.close()


def until(condition):
    end = time.monotonic() + LONG_S
    while not condition():
        assert time.monotonic() < end, "the other process did not answer"
        time.sleep(0.002)


def standing():
    zero = np.zeros(29)
    q = np.where(np.arange(29) == 3, 0.5, 0.0)
    enabled = ~np.isin(np.arange(29), hg.ABSENT[MACHINE])
    return CheckedCommand(q=q, dq=zero, tau=zero, kp=LIMITS.kp, kd=LIMITS.kd, enabled=enabled)


def test_states_come_and_commands_arrive():
    domain = next(DOMAINS)
    with peer("robot", domain) as robot, linked(domain) as (_, link):
        until(lambda: link.state() is not None and link.counts().taken > 20)
        assert link.state().mode_machine == MACHINE
        check_sole_publisher(link, MonotonicClock(), listen_s=0.1)
        before = link.counts().taken
        until(lambda: link.publish(standing()) or (link.state() and link.counts().taken > before + 50))
        assert robot.stdout.readline().split() == ["command", "6", "0.5"]
        assert link.counts().foreign_commands == 0  # what we send ourselves is not foreign
        robot.kill()
        robot.wait()
        last = link.state().sequence
        until(lambda: link.state().age_s > 0.2)
        assert link.state().sequence - last <= 1 and not link.counts().refused


def test_age_is_an_upper_bound():
    clock = SimulatedClock()
    with DdsNode(domain=next(DOMAINS), interface=LOOPBACK) as node:
        link, robot = DdsLink(node, clock), DdsRobot(node, clock)
        for tick, waits_s in ((1, 1.0), (2, 3.0)):
            clock.sleep(waits_s)
            robot.publish_state(low_state(np.random.default_rng(0), tick=tick))
            time.sleep(0.2)
            assert link.state().age_s == waits_s and link.state().sequence == tick
        for end in (robot, link):
            end.close()


def test_somebody_else_commands():
    domain = next(DOMAINS)
    with peer("robot", domain), peer("commander", domain), linked(domain) as (_, link):
        until(lambda: link.state() is not None and link.counts().foreign_commands > 0)
        with pytest.raises(SecondPublisher, match="somebody else"):
            check_sole_publisher(link, MonotonicClock())


def test_rubbish_on_the_topic():
    domain = next(DOMAINS)
    with peer("babbler", domain), linked(domain) as (_, link):
        until(
            lambda: link.state() is not None and link.counts().taken > 50 and sum(link.counts().refused.values()) > 50
        )
        assert link.counts().refused.keys() <= {"length", "crc"}


def test_the_motion_switcher():
    domain = next(DOMAINS)
    with peer("server", domain), DdsNode(domain=domain, interface=LOOPBACK) as node:
        service = DdsService(node, SERVICE)
        assert active_controller(service, timeout_s=LONG_S) == "ai"
        assert leave_high_level(service, MonotonicClock(), robot_is_held=True, timeout_s=LONG_S, pause_s=0.0) == 1
        assert active_controller(service) == ""
        assert service.call(1002, "{}", LONG_S).code == 3203
        service.close()


def test_a_service_that_is_not_there():
    with DdsNode(domain=next(DOMAINS), interface=LOOPBACK) as node:
        service = DdsService(node, SERVICE)
        for wrong in (np.nan, np.inf, 0.0):
            with pytest.raises(InvalidConfig, match="timeout_s is .*above 0"):
                service.call(1001, "{}", wrong)
        with pytest.raises(ServiceError, match="nobody serves 'motion_switcher'"):
            active_controller(service, timeout_s=0.1)
        silent = DdsServer(node, SERVICE, lambda api_id, parameter: (0, ""))
        with pytest.raises(ServiceError, match="did not answer call 1001"):
            active_controller(service, timeout_s=0.5)
        assert silent.serve() == QUESTIONS
        for end in (silent, service):
            end.close()
