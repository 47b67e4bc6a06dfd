"""What branches share, averaged: weights, normalisers, optimisers, curricula."""

import pytest
import torch

from hotice.learn.branches.mean import joined_normaliser, mean_meta, mean_tensors, spread
from hotice.learn.ppo.networks import Normalizer

NORM = "net.obs_norm."


def normaliser(*batches):
    norm = Normalizer(3)
    for batch in batches:
        norm.update(batch)
    return norm


def named(norm, prefix=NORM):
    return {prefix + name: value for name, value in norm.state_dict().items()}


def part(value, rung=1, ended=4.0):
    """Tensors of a checkpoint, all of them `value` where that makes sense."""
    norms = named(normaliser(torch.full((8, 3), value))) | named(normaliser(), "net.critic_norm.")
    return norms | {
        "net.nets.low.actor.0.weight": torch.full((2, 2), value),
        "net.nets.low.critic.0.weight": torch.full((2, 2), -value),
        "average.nets.low.actor.0.weight": torch.full((2, 2), 2 * value),
        "average_count": torch.tensor(7),
        "optimizer.0.exp_avg": torch.full((2,), 3 * value),
        "curriculum": torch.full((2,), value),
        "stages.distance": torch.tensor(rung),
        "stages.ended": torch.tensor(ended),
        "generator": torch.full((4,), int(value), dtype=torch.uint8),
        "env.physics.qpos": torch.full((2,), value),
        "reached": torch.zeros(2, dtype=torch.bool),
    }


def test_everything_that_is_shared_is_averaged():
    merged = mean_tensors([part(1.0, rung=3, ended=2.0), part(4.0, rung=2, ended=4.0)])
    assert {"env.physics.qpos", "reached"} & set(merged) == set()
    for name, value in {
        "net.nets.low.actor.0.weight": 2.5,
        "net.nets.low.critic.0.weight": -2.5,
        "average.nets.low.actor.0.weight": 5.0,
        "optimizer.0.exp_avg": 7.5,
        "curriculum": 2.5,
        "stages.distance": 2,
        "stages.ended": 3.0,
        "average_count": 7,
        "generator": 1,
    }.items():
        assert set(merged[name].flatten().tolist()) == {value}, name


def test_of_one_branch_the_average_is_itself_to_the_last_bit():
    torch.manual_seed(0)
    alone = part(0.1) | named(normaliser(torch.randn(50, 3), 1e3 + torch.randn(7, 3)))
    merged = mean_tensors([alone])
    assert all(torch.equal(value, alone[name]) and value.dtype == alone[name].dtype for name, value in merged.items())


def test_normalisers_are_joined_as_if_one_had_seen_all():
    torch.manual_seed(0)
    batches = [torch.randn(n, 3) * scale + shift for n, scale, shift in ((40, 1.0, 0.0), (10, 3.0, 5.0), (25, 0.1, -2))]
    joined = joined_normaliser(NORM, [named(normaliser(batch)) for batch in batches])
    together = named(normaliser(torch.cat(batches)))
    for name in ("mean", "var"):
        torch.testing.assert_close(joined[NORM + name], together[NORM + name], rtol=1e-4, atol=1e-5)
    assert float(joined[NORM + "count"]) == pytest.approx(25, abs=1e-3)


def test_rates_are_averaged_and_skips_added():
    metas = [
        {"sha256": "a", "update": 3, "branch": {"round": None}, "skipped": 1, "learning_rates": [1.0, 2.0], "kept": 5},
        {"sha256": "b", "update": 3, "branch": {"round": None}, "skipped": 2, "learning_rates": [3.0, 2.0], "kept": 6},
    ]
    assert mean_meta(metas) == {"skipped": 3, "learning_rates": [2.0, 2.0], "kept": 5}


def test_how_far_and_how_far_apart():
    name = "net.nets.low.actor.0.weight"
    before = {name: torch.zeros(2), "net.obs_norm.mean": torch.zeros(2)}
    parts = [{name: torch.tensor([3.0, 5.0])}, {name: torch.tensor([3.0, 3.0])}]
    assert spread(before, parts) == (5.0, 1.0)
