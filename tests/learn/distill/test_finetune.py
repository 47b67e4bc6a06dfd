import dataclasses

import pytest
import torch

from hotice.errors import InvalidConfig
from hotice.learn.distill.config import DistillConfig, FinetuneConfig
from hotice.learn.distill.dagger import DistillRunner
from hotice.learn.train.runner import Runner


@pytest.fixture(scope="session")
def make(tiny, run, tmp_path_factory):
    """Function: a tiny fine-tuning of a student that was distilled from the tiny run."""
    folder = tmp_path_factory.mktemp("finetune")
    base = {f.name: getattr(tiny(folder), f.name) for f in dataclasses.fields(tiny(folder))} | {"perturbed": True}
    DistillRunner(DistillConfig(**base | {"teachers": (run,), "out": folder / "student", "updates": 1})).train()

    def config(out, **changes):
        return FinetuneConfig(**(base | {"init": folder / "student", "out": out} | changes))

    return config


def parameters(runner, part):
    return torch.cat([p.detach().flatten() for n, p in runner.net.named_parameters() if part in n])


def test_critics_learn_alone_first(make, tmp_path):
    runner = Runner(make(tmp_path, critic_updates=1))
    assert not runner.env.config.sensing.exact and not runner.env.config.dynamics.nominal
    parts = ("actor", "log_std", "critic")
    before = {part: parameters(runner, part) for part in parts}
    runner.learn_once()
    assert torch.equal(parameters(runner, "actor"), before["actor"])
    assert torch.equal(parameters(runner, "log_std"), before["log_std"])
    assert not torch.equal(parameters(runner, "critic"), before["critic"])
    runner.learn_once()
    assert all(not torch.equal(parameters(runner, part), before[part]) for part in parts)


def test_the_optimiser_of_another_objective_is_left_behind(make, tiny, run, tmp_path):
    fresh, going_on = Runner(make(tmp_path / "a")), Runner(make(tmp_path / "b", init=run))
    assert not fresh.algo.optimizer.state_dict()["state"] and going_on.algo.optimizer.state_dict()["state"]
    assert fresh.algo.optimizer.param_groups[0]["lr"] == tiny(tmp_path).ppo.learning_rate


def test_resuming_while_critics_learn_alone_is_bit_for_bit(make, tmp_path):
    whole = Runner(make(tmp_path / "whole", critic_updates=2, updates=3))
    whole.train()
    Runner(make(tmp_path / "parts", critic_updates=2, updates=1)).train()
    parts = Runner(make(tmp_path / "parts", critic_updates=2, updates=3, resume=True))
    parts.train()
    assert all(
        torch.equal(a, b) for a, b in zip(whole.net.state_dict().values(), parts.net.state_dict().values(), strict=True)
    )


def test_a_student_is_needed(make, tmp_path):
    with pytest.raises(InvalidConfig, match="no init"):
        make(tmp_path, init=None)
