"""A run that begins with the networks of one whose observation had fewer rows."""

import pytest
import torch

from hotice.errors import CheckpointError
from hotice.learn.config import PpoConfig, TrainConfig
from hotice.learn.runner import Runner
from hotice.learn.widen import columns_within, widen
from hotice.sim.config import TaskConfig

SMALL = {
    "scenes": ("pipe",), "num_envs": 8, "threads": 1, "hidden": (16,), "critic_hidden": (16,),
    "ppo": PpoConfig(steps=4, minibatches=2),
}  # fmt: skip


def test_columns_of_an_observation_within_another():
    assert columns_within([("a", 2), ("c", 1)], [("a", 2), ("b", 3), ("c", 1)]).tolist() == [0, 1, 5]
    assert columns_within([("a", 2)], [("a", 3)]) is None
    assert columns_within([("z", 2)], [("a", 2)]) is None


def test_only_what_reads_the_observation_becomes_wider():
    tensors = {
        "net.obs_norm.mean": torch.ones(2), "net.obs_norm.var": torch.full((2,), 3.0),
        "net.nets.low.actor.0.weight": torch.ones(4, 2), "net.nets.low.critic.0.weight": torch.ones(4, 5),
        "optimizer.1.exp_avg": torch.ones(4, 2), "optimizer.2.exp_avg": torch.ones(4), "optimizer.1.step": torch.tensor(3.0),
    }  # fmt: skip
    wider = widen(tensors, torch.tensor([0, 2]), 3, "obs_norm", "actor")
    assert wider["net.obs_norm.mean"].tolist() == [1.0, 0.0, 1.0] and wider["net.obs_norm.var"].tolist() == [
        3.0,
        1.0,
        3.0,
    ]
    for name in ("net.nets.low.actor.0.weight", "optimizer.1.exp_avg"):
        assert wider[name].tolist() == [[1.0, 0.0, 1.0]] * 4
    for name in ("net.nets.low.critic.0.weight", "optimizer.2.exp_avg", "optimizer.1.step"):
        assert torch.equal(wider[name], tensors[name])


def test_a_run_with_the_scan_begins_as_the_one_without_it_ended(tmp_path):
    first = Runner(TrainConfig(out=tmp_path / "first", average=0.0, **SMALL))
    for _ in range(2):
        first.learn_once()
    first.save()
    wide = Runner(
        TrainConfig(out=tmp_path / "wide", init=tmp_path / "first", task=TaskConfig(scan=True), **SMALL)  # type: ignore[arg-type]
    )
    size = first.env.policy_table.size
    assert wide.obs.shape[1] == size + 40
    varied = first.net.obs_norm.var >= 1e-5  # the others are taken out when a run begins with another's networks
    observation = torch.where(varied, torch.randn(5, size), first.net.obs_norm.mean)
    scanned = torch.cat([observation, torch.rand(5, 40)], dim=1)
    # a constant input gets weight zero: it did nothing but add to the biases, which stay
    with torch.no_grad():
        for agent in first.net.agents:
            first.net.nets[agent.name].actor[0].weight[:, ~varied] = 0.0
        torch.testing.assert_close(wide.net.act(scanned), first.net.act(observation), rtol=0, atol=1e-6)
    wide.learn_once()
    with pytest.raises(CheckpointError, match="observation layout differs"):
        Runner(TrainConfig(out=tmp_path / "narrow", init=save(wide), **SMALL))


def save(runner):
    runner.save()
    return runner.config.out
