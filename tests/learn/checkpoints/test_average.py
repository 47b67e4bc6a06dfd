import dataclasses

import pytest
import torch

from hotice.errors import InvalidConfig
from hotice.learn.checkpoints.average import COUNT, PREFIX, AveragedPolicy, averaged
from hotice.learn.checkpoints.checkpoint import load_checkpoint
from hotice.learn.policy import torch_policy
from hotice.learn.ppo.networks import ActorCritic
from hotice.learn.train.config import TrainConfig
from hotice.learn.train.runner import Runner
from hotice.task.presets import get_preset


@pytest.fixture
def net():
    torch.manual_seed(0)
    return ActorCritic(get_preset("dual_hodpf").agents, 5, 7, (4,), (4,), (0.6, 0.3))


def fill(net, value):
    with torch.no_grad():
        for tensor in net.state_dict().values():
            tensor.fill_(value)


def test_weights_are_averaged_over_about_a_tenth_of_the_updates(net):
    fill(net, 0.0)
    average, value = AveragedPolicy(net, 0.9), 0.0
    for n in range(1, 31):
        fill(net, float(n))
        average.update(net)
        keep = min(0.9, n / (10 + n))
        value = keep * value + (1 - keep) * n
    for tensor in average.tensors.values():
        torch.testing.assert_close(tensor, torch.full_like(tensor, value))
    assert 25 < value < 30


def test_it_holds_what_acts_and_nothing_else(net):
    names = set(AveragedPolicy(net, 0.9).tensors)
    assert {"obs_norm.mean", "obs_norm.var", "nets.low.actor.0.weight", "nets.up.log_std"} <= names
    assert not [n for n in names if "critic" in n or n.endswith("count")]
    fill(net, 0.5)
    acting = net.act(torch.ones(1, 5))
    average = AveragedPolicy(net, 0.9)
    fill(net, 2.0)
    tensors = averaged({f"net.{k}": v for k, v in net.state_dict().items()} | average.state())
    net.load_state_dict({k.removeprefix("net."): v for k, v in tensors.items() if k.startswith("net.")})
    torch.testing.assert_close(net.act(torch.ones(1, 5)), acting)
    assert (net.state_dict()["nets.low.critic.0.weight"] == 2.0).all(), "critics are the newest"


def test_a_checkpoint_acts_by_its_average(run):
    tensors, meta = load_checkpoint(run)
    assert int(tensors[COUNT]) == meta["update"] == 2
    policy, key = torch_policy(run), "nets.low.actor.0.weight"
    held = dict(policy.net.named_parameters())[key]
    assert torch.equal(held, tensors[PREFIX + key]) and not torch.equal(held, tensors[f"net.{key}"])


def test_without_it_the_newest_weights_act(tiny, tmp_path):
    Runner(tiny(tmp_path / "run", average=0.0)).train()
    tensors = load_checkpoint(tmp_path / "run")[0]
    assert not [k for k in tensors if k.startswith("average")]
    key = "nets.up.actor.0.bias"
    assert torch.equal(dict(torch_policy(tmp_path / "run").net.named_parameters())[key], tensors[f"net.{key}"])


def test_another_run_begins_at_the_average(run, tiny, tmp_path):
    saved, key = load_checkpoint(run)[0], "nets.low.actor.0.bias"
    runner = Runner(tiny(tmp_path / "next", init=run))
    assert torch.equal(runner.net.state_dict()[key], saved[PREFIX + key]) and runner.average.count == 0
    assert torch.equal(runner.average.tensors[key], saved[PREFIX + key])


def test_a_run_from_before_there_was_one_goes_on(tiny, tmp_path):
    Runner(tiny(tmp_path / "run", average=0.0)).train()
    runner = Runner(tiny(tmp_path / "run", updates=3, resume=True))
    key = "nets.low.actor.0.bias"
    assert runner.average.count == 0 and torch.equal(runner.average.tensors[key], runner.net.state_dict()[key])
    runner.train()
    assert int(load_checkpoint(tmp_path / "run")[0][COUNT]) == 1


@pytest.mark.parametrize("value", [-0.1, 1.0, float("nan")])
def test_shares_that_are_none(value):
    with pytest.raises(InvalidConfig, match="average is .* from 0 to below 1"):
        dataclasses.replace(TrainConfig(), average=value)
