"""Rollouts for looking at end as evaluation says that they end."""

import numpy as np
import pytest
import torch

import hotice.evaluate.start as start
from hotice.errors import CheckpointError, InvalidConfig
from hotice.evaluate.conditions import Conditions
from hotice.evaluate.record import record_rollouts
from hotice.evaluate.scorer import score_block
from hotice.learn.policy import load_policy
from hotice.model import Box
from hotice.model.carry import solve_carry
from hotice.model.geometry.shapes import BoxShape, SphereShape
from hotice.model.moving import Motion, WayPoint
from hotice.model.scene import Obstacle, Scene
from hotice.sim.snapshot import NUM_SGF
from hotice.task.moving import KNOWN, MovingConfig


@pytest.fixture(scope="module")
def states():
    return [solve_carry(Box((0.3, 0.3, 0.3), 1.0)), solve_carry(Box((0.22, 0.34, 0.25), 3.0))]


class Acting:
    """The same action all the time."""

    name = "acting"

    def __init__(self, meta, action=0.0):
        self.meta, self.action = meta, action

    def act(self, obs):
        return torch.full((len(obs), 20), self.action)


@pytest.fixture(scope="module")
def meta(onnx_file):
    return load_policy(onnx_file).meta


SCENES = {
    "success": (Scene("near", goal=(0.04, 0.0)), 0.0),
    "object_collision": (
        Scene("block", obstacles=(Obstacle("it", "side", BoxShape((0.3, 0.3, 0.1)), (0.62, 0.0, 0.85)),)),
        0.0,
    ),
    "robot_collision": (
        Scene("aside", obstacles=(Obstacle("it", "side", BoxShape((0.1, 0.3, 0.3)), (0.05, 0.31, 0.9)),)),
        0.0,
    ),
    "drop": (Scene("open"), 3.0),
}


@pytest.mark.parametrize("cause", SCENES)
def test_a_rollout_ends_as_its_trial(cause, meta, states):
    scene, action = SCENES[cause]
    asked = Conditions(perturbed=False, protocol="paper")
    trials = score_block(Acting(meta, action), scene, states, 4, asked)
    records = record_rollouts(Acting(meta, action), scene, states, asked, seed=4, threads=1)
    assert [r.outcome for r in records] == list(trials.outcome) and set(trials.outcome) == {cause}
    for record, time_s, distance_m in zip(records, trials.time_s, trials.distance_m, strict=True):
        assert record.time_s[-1] == pytest.approx(time_s) and np.allclose(np.diff(record.time_s), 0.02)
        assert record.distance_m == pytest.approx(distance_m, abs=1e-5)
        assert (record.scene, record.policy) == (scene, "acting")


class Still(Acting):
    """The robot stands in its carry state; what it reads is kept."""

    def __init__(self, meta):
        super().__init__(meta)
        self.seen = []

    def act(self, obs):
        self.seen.append(obs.clone())
        return super().act(obs)


def test_who_stands_is_walked_into_and_the_touch_tells_so(meta, states):
    """Whatever is known of it; and what is read differs by what is known."""
    ways = tuple(WayPoint(time_s=t, position_m=(x, 0.0, 0.95)) for t, x in ((0.0, 2.2), (0.6, 0.16)))
    ball = Obstacle("ball", "side", SphereShape(0.1), (2.2, 0.0, 0.95), motion=Motion(way_points=ways))
    scene, read = Scene("thrown", obstacles=(ball,)), {}
    for known in KNOWN:
        policy, asked = Still(meta), Conditions(perturbed=False, moving=MovingConfig(known=known))
        (record,) = record_rollouts(policy, scene, states[:1], asked, threads=1)
        assert record.outcome == "walked_into" and 0.2 < record.time_s[-1] < 0.6
        (touch, *_) = [event for event in record.events if event.kind == "touch"]
        assert touch.text == "ball walks into object: the robot stands" and touch.time_s == pytest.approx(
            record.time_s[-1]
        )
        read[known] = torch.stack(policy.seen)
    assert not torch.allclose(read["still"], read["near"]) and not torch.allclose(read["near"], read["live"])


@pytest.fixture
def scripted(monkeypatch):
    """Function: from control step t on the goal counts as reached, and from u on the object as hit; no physics."""

    def script(reached=10**9, hit=10**9):
        class Scripted(start.TransportEnv):
            steps = 0

            def step(self, action):
                self.steps += 1
                seen = self.snapshot()
                seen.object_hit[:] = self.steps >= hit
                still = torch.zeros(self.num_envs, dtype=torch.int64)
                away = torch.full((self.num_envs,), 0.0 if self.steps >= reached else 1.0)
                rest = dict(self_depth=torch.zeros(self.num_envs))
                return type("Step", (), dict(policy=action, outcome=still, goal_distance=away, seen=seen, **rest))

        monkeypatch.setattr(start, "TransportEnv", Scripted)

    return script


def test_a_trial_lasts_five_seconds_and_its_last_step_counts(meta, states, scripted):
    for reached, hit, outcome in ((250, 10**9, "success"), (251, 251, "timeout"), (250, 250, "object_collision")):
        scripted(reached, hit)
        (record,) = record_rollouts(Acting(meta), Scene("open"), states[:1], threads=1)
        assert record.outcome == outcome and record.time_s[-1] == pytest.approx(5.0) and len(record.time_s) == 251


def test_what_follows_the_end_is_shown_on_demand(meta, states, scripted):
    for after_s, last_s in ((0.0, 0.2), (0.3, 0.5), (9.0, 5.0)):
        scripted(reached=10)
        (record,) = record_rollouts(Acting(meta), Scene("open"), states[:1], after_s=after_s, threads=1)
        assert record.outcome == "success" and record.time_s[-1] == pytest.approx(last_s)


def test_arrows_are_the_fields_at_the_keypoints(meta, states):
    (record,) = record_rollouts(Acting(meta), Scene("near", goal=(0.3, 0.0)), states[:1], threads=1)
    frames = len(record.time_s)
    assert record.arrow_pos_W.shape == record.arrow_force_W.shape == (frames, NUM_SGF + 10, 3)
    assert record.arrow_is_ogf.tolist() == [False] * NUM_SGF + [True] * 10
    pelvis = record.arrow_force_W[0, 4]  # on an open floor straight at the goal
    assert pelvis[0] > 0.5 and abs(pelvis[1]) < 0.2 * pelvis[0]


def test_refusals(meta, states):
    with pytest.raises(InvalidConfig, match="at least one object"):
        record_rollouts(Acting(meta), Scene("open"), [])
    other = meta | {"layout": [["gyro", 4], *meta["layout"][1:]]}
    with pytest.raises(CheckpointError, match="observation layout differs"):
        record_rollouts(Acting(other), Scene("open"), states[:1], threads=1)
