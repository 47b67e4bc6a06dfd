"""A run as an MCAP file, read back by mcap's own reader."""

import json
import sys
from collections import Counter

import numpy as np
import pytest

from hotice.deploy.seeing import read_run, write_mcap
from hotice.errors import InvalidConfig, MissingExtra
from hotice.model import g1
from hotice.policy import PolicyTask, read_fields
from tests.deploy.seeing_fixture import BLIND, TICKS, estimate_at, made, robot_at, write_run


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    return read_run(write_run(tmp_path_factory.mktemp("log")))


@pytest.fixture(scope="module")
def back(run, tmp_path_factory):
    """Messages as (schema, channel, log time [ns], said)."""
    reader = pytest.importorskip("mcap.reader")
    path = write_mcap(run, tmp_path_factory.mktemp("mcap") / "run.mcap")
    with open(path, "rb") as file:
        found = list(reader.make_reader(file, validate_crcs=True).iter_messages())
    return [(schema, channel, message.log_time, json.loads(message.data)) for schema, channel, message in found]


def test_every_message_comes_back_in_time(back):
    assert Counter(channel.topic for _, channel, _, _ in back) == {
        "/estimate": TICKS - BLIND - 1,
        "/guidance": TICKS - BLIND - 1,
        "/targets": TICKS,
        "/mode": 4,
        "/fault": 1,
    }
    times = [t for *_, t, _ in back]
    assert times == sorted(times)
    modes_ns = [t for _, channel, t, _ in back if channel.topic == "/mode"]
    assert modes_ns == [999_500_000_000, 1_000_500_000_000, 1_001_000_000_000, 1_001_500_000_000]


def test_messages_say_what_was(back):
    estimates = [(t, said) for _, channel, t, said in back if channel.topic == "/estimate"]
    t, said = estimates[7]
    robot = robot_at(BLIND + 7)
    assert t == 1_000_340_000_000
    np.testing.assert_allclose(said["p_WP"], robot.p_WP, atol=1e-9)
    np.testing.assert_allclose(np.abs(np.dot(said["quat_WP"], robot.quat_WP)), 1.0, atol=1e-9)
    np.testing.assert_allclose(said["joint_pos"], robot.joint_pos, atol=1e-6)
    np.testing.assert_allclose(said["p_WO"], robot.p_WO, atol=1e-9)
    assert (said["mode"], said["cause"], said["pose_age_s"]) == ("damping", "operator", 0.1)
    targets = [said for _, channel, _, said in back if channel.topic == "/targets"]
    assert targets[3]["number"] == 4 and targets[3]["q"] == [0.003] * 29 and targets[3]["warm"] is True
    assert targets[3]["box_age_s"] is None
    (fault,) = [said for _, channel, _, said in back if channel.topic == "/fault"]
    assert fault == {"mode": "carry", "cause": "box unseen", "text": "hold: the box was not seen for 2.1 s"}
    guided = [said for _, channel, _, said in back if channel.topic == "/guidance"][7]
    reading = read_fields(made().pf, estimate_at(BLIND + 7).percept, PolicyTask.from_meta(made().policy.meta))
    assert guided["c_W"] == reading.c_W.tolist() and guided["nearest_m"] == reading.distance.min()
    goal = made().pf.scene.goal
    assert guided["goal_distance_m"] == pytest.approx(np.hypot(goal[0] - 0.17, goal[1] + 0.2))


def test_messages_fit_their_schemas(back):
    for schema, channel, _, said in back:
        assert (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
        properties = json.loads(schema.data)["properties"]
        assert said.keys() == properties.keys()
        for name, value in said.items():
            if properties[name]["type"] == "array":
                assert len(value) == properties[name]["minItems"]
        assert channel.metadata["joints"].split(",") == list(g1.ALL_JOINTS)


def test_without_the_package_the_extra_is_named(run, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "mcap.writer", None)
    with pytest.raises(MissingExtra, match=r"needs mcap.*hotice\[mcap\]"):
        write_mcap(run, tmp_path / "run.mcap")
    assert list(tmp_path.iterdir()) == []


def test_another_ending_is_refused(run, tmp_path):
    pytest.importorskip("mcap")
    with pytest.raises(InvalidConfig, match="ends in .mcap"):
        write_mcap(run, tmp_path / "run.bag")
