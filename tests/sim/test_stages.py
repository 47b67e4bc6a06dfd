"""Starts near the goal and small objects, for a curriculum."""

import pytest
import torch

from hotice.sim import TaskConfig
from hotice.sim.events import Starter
from hotice.sim.starts import NEAREST_M

CPU = torch.device("cpu")


@pytest.fixture
def held_back(make_env):
    """Function: an environment that holds back starts and objects, with limits."""

    def make(limit_m=None, share=None, **config):
        env = make_env(64, **config)
        env.starter.hold_back(far=limit_m is not None, large=share is not None)
        if limit_m is not None:
            env.starter.near.limit_m = limit_m
        if share is not None:
            env.starter.small.share = share
        env.reset()
        return env

    return make


def way(env):
    """Geodesic distance of each robot to its goal [m]."""
    p = env.physics.qpos[:, None, :3].float().clone()
    p[..., 2] = 0.75
    return env.bank.sample("sgf", env.memory.scene, p).geodesic[:, 0]


@pytest.mark.parametrize("anywhere", [0.0, 0.7])
def test_no_start_is_farther_than_the_limit(held_back, anywhere):
    env = held_back(1.0, anywhere=anywhere, start_noise_m=0.02)
    assert NEAREST_M - 0.05 < float(way(env).min()) and float(way(env).max()) < 1.05
    assert float(way(env).std()) > 0.1, "starts differ"
    env.starter.near.limit_m = env.starter.near.farthest_m
    env.reset()
    assert float(way(env).max()) > 1.5


def test_at_the_top_the_scenes_own_starts_come_back(held_back, make_env):
    env, usual = held_back(99.0, anywhere=0.0), make_env(64)
    usual.reset()
    torch.testing.assert_close(way(env), way(usual), atol=0.25, rtol=0)


def test_a_scene_without_a_place_within_the_limit_gives_its_nearest(held_back):
    env = held_back(0.01, start_noise_m=0.0)
    near = env.starter.near
    places = near.draw(torch.arange(3), env.generator)
    assert torch.equal(places, near.places[:, 0]) and (near.way_m[:, 0] == near.way_m.min(dim=1).values).all()


def test_small_objects_come_first_and_each_gets_its_own_model(held_back, carry):
    env = held_back(share=0.5)
    size = carry.grasp.half_extents.norm(dim=1)
    smallest = set(size.argsort()[:2].tolist())
    assert set(env.memory.model.tolist()) == smallest
    env.starter.small.share = 1.0
    env.reset()
    assert set(env.memory.model.tolist()) == set(range(4))
    s = env.snapshot()
    assert torch.equal(s.grasp.half_extents, carry.grasp.half_extents[env.memory.model])
    env.starter.small.share = 1e-9
    env.reset()
    assert set(env.memory.model.tolist()) == {int(size.argmin())}


def test_nothing_is_held_back_unless_asked_for(make_env):
    env = make_env()
    assert env.starter.near is None and env.starter.small is None
    starter = Starter(TaskConfig(), env.bank, env.carry, env.layout, CPU)
    starter.hold_back(far=False, large=False)
    assert starter.near is None and starter.small is None
