"""Whether trials are independent: what is drawn for the same trial number in different scenes has nothing in common."""

import numpy as np
import pytest
import torch

from hotice.learn.conditions import Conditions, start_trials
from hotice.learn.seeds import TrialSeeds, object_seed
from hotice.learn.spread import spread_ratio
from hotice.model import Box, load_scene
from hotice.model.carry import solve_carry
from hotice.model.scene import Obstacle, Scene
from hotice.model.shapes import BoxShape
from hotice.sim.events import push

SCENES, TRIALS, POOL = 12, 400, 64


def scene(number):
    return Scene(
        "row", obstacles=(Obstacle("post", "side", BoxShape((0.1, 0.1, 1.0)), (1.0, 0.6 + 0.01 * number, 0.5)),)
    )


def correlated(rows):
    """Largest correlation between rows (S, T)."""
    return np.abs(np.corrcoef(rows) - np.eye(len(rows))).max()


@pytest.mark.parametrize("seed", range(5))
def test_trials_of_the_same_number_have_nothing_in_common(seed):
    """Robots, and objects by their rank. Of 66 pairs of 400 pairs of numbers each, chance gives r > 0.24 once in 10,000 tests."""
    seeds = [TrialSeeds.of(seed, scene(i)) for i in range(SCENES)]
    robots = np.array([[rng.uniform() for rng in s.robots(0, TRIALS)] for s in seeds])
    objects = np.array([s.objects(TRIALS, POOL) for s in seeds], dtype=float)
    noise = np.array([torch.rand(TRIALS, generator=torch.Generator().manual_seed(s.block(0))).numpy() for s in seeds])
    for rows in (robots, objects, noise):
        assert correlated(rows) < 0.24
    together = np.concatenate([robots, noise, objects])
    assert correlated(together) < 0.25  # nor with each other


def test_the_spread_over_trial_numbers_is_binomial():
    """Success made of a trial's robot and its start, bar: 15 %; scenes that share their robots: far more."""
    level = np.linspace(0.6, 0.95, 20)[:, None]

    def won(of):
        parts = []
        for seed in range(5):
            drawn = [of(seed, i) for i in range(20)]
            robot = np.array([[rng.uniform() for rng in s.robots(0, 200)] for s in drawn])
            start = [torch.rand(200, generator=torch.Generator().manual_seed(s.block(0))).numpy() for s in drawn]
            parts.append(0.5 * (robot + np.array(start)) < level)
        return np.concatenate(parts, axis=1)

    assert spread_ratio(won(lambda seed, i: TrialSeeds.of(seed, scene(i)))) == pytest.approx(1.0, abs=0.1)
    assert spread_ratio(won(lambda seed, i: TrialSeeds(seed, 0))) > 3.0


def test_each_object_is_carried_as_often():
    order = TrialSeeds.of(3, scene(0)).objects(150, 50)
    assert (np.bincount(order) == 3).all() and sorted(order[:50]) == list(range(50))
    assert not np.array_equal(order[:50], order[50:100])
    assert np.array_equal(TrialSeeds.of(3, scene(0)).objects(70, 50), order[:70])


def test_scene_and_seed_decide(tmp_path):
    """A scene is known by its content, from wherever it comes."""
    place = load_scene("gap")
    place.save(tmp_path / "copy.json")
    again = load_scene(str(tmp_path / "copy.json"))
    assert TrialSeeds.of(1, place) == TrialSeeds.of(1, again) != TrialSeeds.of(1, scene(0))
    blocks = [TrialSeeds.of(s, scene(i)).block(b) for s in range(4) for i in range(5) for b in (0, 250, 500)]
    assert len(set(blocks)) == 60 and object_seed(0) != object_seed(1)


def test_what_environments_draw_has_nothing_in_common():
    """Starts, encoders, gains, delays, noise and pushes of 60 trials with the same object in two scenes, and within one."""
    state = solve_carry(Box((0.3, 0.3, 0.3), 1.0))
    drawn = []
    for place in (scene(0), scene(1)):
        env = start_trials(place, [state] * 60, 0, Conditions())
        obs, _ = env.reset()
        start = env.physics.qpos[:, :2].clone()
        noise = obs - env.truth
        for _ in range(500):
            push(env.physics, env.config, env.generator)
        pushes = env.physics.qvel[:, 0].clone()
        gain = np.array([m.actuator_gainprm[:, 0] for m in env.carry.models])
        assert len(np.unique(gain[:, 0])) == 60 and len(set(map(id, env.carry.models))) == 60
        drawn.append(
            {
                "start": start[:, 0].numpy(), "encoder": env.carry.joint_offset[:, 3].numpy(), "gain": gain[:, 0],
                "delay": env.sensors.action_delay.numpy().astype(float), "noise": noise[:, 8].numpy(),
                "pushes": pushes.numpy(),
            }
        )  # fmt: skip
    for name in drawn[0]:
        a, b = drawn[0][name], drawn[1][name]
        assert np.std(a) > 0 and abs(np.corrcoef(a, b)[0, 1]) < 0.5, name


def test_trials_of_other_blocks_have_other_robots():
    seeds = TrialSeeds.of(0, scene(0))
    whole = [rng.uniform() for rng in seeds.robots(0, 10)]
    assert [rng.uniform() for rng in seeds.robots(4, 6)] == whole[4:] and len(set(whole)) == 10
