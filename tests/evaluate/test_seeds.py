"""Whether trials are independent: what is drawn for the same trial number in different scenes has nothing in common."""

import numpy as np
import pytest
import torch

from hotice.evaluate.conditions import Conditions
from hotice.evaluate.seeds import TrialSeeds, object_seed
from hotice.evaluate.spread import spread_ratio
from hotice.evaluate.start import start_trials
from hotice.model import Box, builder, load_scene
from hotice.model.carry import solve_carry
from hotice.model.geometry.shapes import BoxShape
from hotice.model.scene import Obstacle, Scene
from hotice.sim.events import push
from hotice.task.rules import OUTCOMES

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
    """Robots, and objects by their rank. Of 66 pairs of 400 pairs of numbers each, chance gives r > 0.24 once in 10,000
    tests."""
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
    """Starts, encoders, gains, delays, noise and pushes of 60 trials with the same object in two scenes, and within
    one."""
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
                "start": start[:, 0].numpy(),
                "encoder": env.carry.joint_offset[:, 3].numpy(),
                "gain": gain[:, 0],
                "delay": env.sensors.action_delay.numpy().astype(float),
                "noise": noise[:, 8].numpy(),
                "pushes": pushes.numpy(),
            }
        )
    for name in drawn[0]:
        a, b = drawn[0][name], drawn[1][name]
        assert np.std(a) > 0 and abs(np.corrcoef(a, b)[0, 1]) < 0.5, name


def test_trials_of_other_blocks_have_other_robots():
    seeds = TrialSeeds.of(0, scene(0))
    whole = [rng.uniform() for rng in seeds.robots(0, 10)]
    assert [rng.uniform() for rng in seeds.robots(4, 6)] == whole[4:] and len(set(whole)) == 10


def test_what_happens_to_a_trial_changes_nothing_for_the_others():
    """One falls or not: the other reads the same to the bit, and what ended is not started anew."""
    state, read = solve_carry(Box((0.3, 0.3, 0.3), 1.0)), []
    for throw in (False, True):
        env = start_trials(scene(0), [state] * 2, 0, Conditions())
        env.reset()
        rows, fell = [], []
        for t in range(20):
            if throw and t == 4:
                env.physics.qpos[0, 2] = 0.2
            step = env.step(torch.zeros(2, 20))
            rows.append(step.policy[1])
            fell.append(OUTCOMES[step.outcome[0]] == "fall")
            assert torch.equal(step.seen.goal_distance, step.goal_distance)
        read.append(torch.stack(rows))
        assert fell[4] == throw and not any(fell[:4]) and step.length.tolist() == [20, 20]
    assert torch.equal(*read)


def test_a_carry_state_is_compiled_once_for_all_its_trials(monkeypatch):
    build, calls = builder.build_model, []
    monkeypatch.setattr(builder, "build_model", lambda *a, **k: calls.append(a) or build(*a, **k))
    one, other = solve_carry(Box((0.3, 0.3, 0.3), 1.0)), solve_carry(Box((0.2, 0.3, 0.3), 1.0))
    calls.clear()
    env = start_trials(scene(0), [one, other, one, one], 0, Conditions())
    assert len(calls) == 2 and [s is one for s in env.carry.states] == [True, False, True, True]
    masses = [m.body_mass.sum() for m in env.carry.models]
    assert len(set(masses)) == 4
    again = start_trials(scene(0), [one, one], 0, Conditions(), first=2)
    assert [m.body_mass.sum() for m in again.carry.models] == masses[2:]
