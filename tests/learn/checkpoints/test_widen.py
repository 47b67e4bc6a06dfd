"""A run that begins with the networks of one whose observation had fewer rows."""

from pathlib import Path

import pytest
import torch

from hotice.errors import CheckpointError
from hotice.learn.checkpoints.widen import alike, columns_within, widen
from hotice.learn.ppo.config import PpoConfig
from hotice.learn.train.config import TrainConfig
from hotice.learn.train.runner import Runner
from hotice.task.config import TaskConfig

SMALL = {
    "scenes": ("pipe",),
    "num_envs": 8,
    "threads": 1,
    "hidden": (16,),
    "critic_hidden": (16,),
    "ppo": PpoConfig(steps=4, minibatches=2),
}


def test_columns_of_an_observation_within_another():
    assert columns_within([("a", 2), ("c", 1)], [("a", 2), ("b", 3), ("c", 1)]).tolist() == [0, 1, 5]
    assert columns_within([("a", 2)], [("a", 3)]) is None
    assert columns_within([("z", 2)], [("a", 2)]) is None


def test_only_what_reads_the_observation_becomes_wider():
    tensors = {
        "net.obs_norm.mean": torch.ones(2),
        "net.obs_norm.var": torch.full((2,), 3.0),
        "net.nets.low.actor.0.weight": torch.ones(4, 2),
        "net.nets.low.critic.0.weight": torch.ones(4, 5),
        "optimizer.1.exp_avg": torch.ones(4, 2),
        "optimizer.2.exp_avg": torch.ones(4),
        "optimizer.1.step": torch.tensor(3.0),
    }
    wider = widen(tensors, [("a", 1), ("c", 1)], [("a", 1), ("b", 1), ("c", 1)], "obs_norm", "actor")
    assert wider["net.obs_norm.mean"].tolist() == [1.0, 0.0, 1.0] and wider["net.obs_norm.var"].tolist() == [
        3.0,
        1.0,
        3.0,
    ]
    for name in ("net.nets.low.actor.0.weight", "optimizer.1.exp_avg"):
        assert wider[name].tolist() == [[1.0, 0.0, 1.0]] * 4
    for name in ("net.nets.low.critic.0.weight", "optimizer.2.exp_avg", "optimizer.1.step"):
        assert torch.equal(wider[name], tensors[name])


def test_other_observations_are_left_alone():
    tensors = {"net.obs_norm.mean": torch.ones(2)}
    assert widen(tensors, [("a", 2)], [("b", 2)], "obs_norm", "actor") is tensors


def test_a_history_begins_with_the_statistics_of_its_rows():
    rows = [("gyro", 3), ("gravity", 3), ("joint_pos", 20), ("joint_vel", 20), ("carry_pos", 20), ("last_action", 20)]
    index = alike([*rows, ("history", 132)])
    assert index[:86].tolist() == list(range(86))
    assert torch.equal(index[86:152], torch.cat([torch.arange(46), torch.arange(66, 86)]))
    assert torch.equal(index[152:], index[86:152])
    runner = Runner(TrainConfig(out=Path("unused"), task=TaskConfig(history=2), **SMALL))  # type: ignore[arg-type]
    layout = runner.env.policy_table.layout()
    old = layout[:-1]
    size = sum(width for _, width in old)
    tensors = {"net.obs_norm.mean": torch.arange(size), "net.obs_norm.var": torch.arange(size) + 0.5}
    wider = widen(tensors, old, layout, "obs_norm", "actor")
    assert torch.equal(wider["net.obs_norm.mean"][size:], torch.cat([torch.arange(46), torch.arange(66, 86)] * 2))
    assert torch.equal(wider["net.obs_norm.var"], wider["net.obs_norm.mean"] + 0.5)


@pytest.mark.parametrize("added", [{"scan": True}, {"history": 3}, {"scan": True, "history": 3}])
def test_a_run_that_reads_more_begins_as_the_one_before_ended(tmp_path, added):
    first = Runner(TrainConfig(out=tmp_path / "first", average=0.0, **SMALL))
    for _ in range(2):
        first.learn_once()
    first.save()
    wide = Runner(
        TrainConfig(out=tmp_path / "wide", init=tmp_path / "first", task=TaskConfig(**added), **SMALL)  # type: ignore[arg-type]
    )
    size = first.env.policy_table.size
    more = 40 * added.get("scan", False) + 66 * added.get("history", 0)
    assert wide.obs.shape[1] == size + more
    varied = first.net.obs_norm.var >= 1e-5  # the others are taken out when a run begins with another's networks
    observation = torch.where(varied, torch.randn(5, size), first.net.obs_norm.mean)
    wider = torch.cat([observation, torch.rand(5, more)], dim=1)
    # a constant input gets weight zero: it did nothing but add to the biases, which stay
    with torch.no_grad():
        for agent in first.net.agents:
            first.net.nets[agent.name].actor[0].weight[:, ~varied] = 0.0
        torch.testing.assert_close(wide.net.act(wider), first.net.act(observation), rtol=0, atol=1e-6)
    wide.learn_once()
    with pytest.raises(CheckpointError, match="observation layout differs"):
        Runner(TrainConfig(out=tmp_path / "narrow", init=save(wide), **SMALL))


def save(runner):
    runner.save()
    return runner.config.out
