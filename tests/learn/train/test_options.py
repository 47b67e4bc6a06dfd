"""Options beside --init and --resume are applied or refused by name, and config.json says what acts."""

import dataclasses
import json
import shutil
from pathlib import Path

import pytest
import torch

from hotice.commands.program import main
from hotice.errors import CheckpointError, InvalidConfig
from hotice.learn.checkpoints.checkpoint import load_checkpoint, save_checkpoint
from hotice.learn.distill.config import PPO_ALONE, DistillConfig, FinetuneConfig
from hotice.learn.ppo.config import PpoConfig
from hotice.learn.train.runner import Runner


def rates(runner):
    return [group["lr"] for group in runner.algo.optimizer.param_groups]


@pytest.fixture
def adapted(tiny, tmp_path):
    """A run of seed 3 whose learning rates have moved from 1e-3 to 2e-3 and 4e-4."""
    runner = Runner(tiny(tmp_path / "run", seed=3, updates=1, scenes=("open_floor", "gap")))
    runner.train()
    for group, rate in zip(runner.algo.optimizer.param_groups, (2e-3, 4e-4), strict=True):
        group["lr"] = rate
    runner.save()
    return tmp_path / "run"


@pytest.mark.parametrize("way", ["resume", "init"])
def test_a_learning_rate_that_is_asked_for_acts(tiny, tmp_path, adapted, way):
    given = dict(out=adapted, resume=True, seed=3) if way == "resume" else dict(out=tmp_path / "next", init=adapted)
    ppo = tiny(tmp_path).ppo

    def begun(**changes):
        return rates(Runner(tiny(**given, ppo=dataclasses.replace(ppo, **changes))))

    assert begun() == [2e-3, 4e-4], "goes on where they stood"
    assert begun(max_learning_rate=1.5e-3) == [1.5e-3, 4e-4]
    assert begun(learning_rate=7e-4) == [7e-4, 7e-4]
    assert begun(learning_rate=5e-3, max_learning_rate=6e-3) == [5e-3, 5e-3]


def test_what_was_asked_for_stays_when_it_is_asked_for_again(tiny, adapted):
    ppo = dataclasses.replace(tiny(adapted).ppo, learning_rate=7e-4)
    runner = Runner(tiny(adapted, resume=True, seed=3, updates=2, ppo=ppo))
    runner.train()
    moved = rates(runner)
    assert moved != [7e-4, 7e-4]
    assert json.loads((adapted / "config.json").read_text())["ppo"]["learning_rate"] == 7e-4
    assert rates(Runner(tiny(adapted, resume=True, seed=3, ppo=ppo))) == moved


def test_a_seed_that_cannot_act_is_refused(tiny, tmp_path, adapted):
    with pytest.raises(CheckpointError, match="seed is 0, but the run goes on with the draws of seed 3: give --seed 3"):
        Runner(tiny(adapted, resume=True))
    assert Runner(tiny(tmp_path / "next", init=adapted, seed=8)).config.seed == 8


@pytest.mark.parametrize("way", ["resume", "init"])
def test_a_spread_that_cannot_act_is_refused(tiny, tmp_path, adapted, way):
    given = dict(out=adapted, resume=True, seed=3) if way == "resume" else dict(out=tmp_path / "next", init=adapted)
    with pytest.raises(CheckpointError, match="init_std is 0.4 0.2, but its networks have .*give --init-std 0.6 0.3$"):
        Runner(tiny(**given, init_std=(0.4, 0.2)))


def test_scenes_are_drawn_alike_where_that_is_asked_for(tiny, adapted):
    weight = Runner(tiny(adapted, resume=True, seed=3, scenes=("open_floor", "gap"))).env.starter.scene_weight
    tensors, meta = load_checkpoint(adapted)
    tensors["env.scene_weight"] = tensors["env.scene_weight"] * torch.tensor([1.0, 0.3])
    kept = {k: v for k, v in meta.items() if k not in ("format", "sha256", "update")}
    save_checkpoint(adapted, meta["update"], tensors, kept)
    options = dict(resume=True, seed=3, scenes=("open_floor", "gap"))
    assert (
        Runner(tiny(adapted, **options)).env.starter.scene_weight.tolist() == (weight * torch.tensor([1, 0.3])).tolist()
    )
    assert Runner(tiny(adapted, **options, curriculum=False)).env.starter.scene_weight.tolist() == [1.0, 1.0]


# --resume beside --init


def test_resuming_needs_no_init(tiny, tmp_path, run, tiny_options):
    first = tmp_path / "first"
    shutil.copytree(run, first)
    out = tmp_path / "next"
    Runner(tiny(out, init=first, updates=1)).train()
    behind = load_checkpoint(out)[1]["ancestors"]
    shutil.rmtree(first)
    for config in (tiny(out, init=first, resume=True, updates=2), tiny(out, resume=True, updates=3)):
        runner = Runner(config)
        runner.train()
        assert runner.update == config.updates
        assert json.loads((out / "config.json").read_text())["init"] == str(first), "what it began from"
        assert load_checkpoint(out)[1]["ancestors"] == behind
    with pytest.raises(CheckpointError, match="init is 'other', but the run began from .*first: leave out --init"):
        Runner(dataclasses.replace(config, init=Path("other")))
    plain = tmp_path / "plain"
    Runner(tiny(plain, updates=1)).train()
    with pytest.raises(CheckpointError, match="but the run began from nothing: leave out --init"):
        Runner(tiny(plain, resume=True, init=run))


def test_finetuning_goes_on_without_its_student(tiny, tmp_path, run):
    fields = vars(tiny(tmp_path / "tuned")) | {"perturbed": False}
    config = FinetuneConfig(**fields | {"init": run, "updates": 1})
    Runner(config).train()
    assert Runner(FinetuneConfig(**fields | {"init": None, "resume": True})).update == 1
    with pytest.raises(InvalidConfig, match="no init: the checkpoint or run of a student is needed"):
        Runner(FinetuneConfig(**fields | {"init": None, "resume": True, "out": tmp_path / "empty"}))
    assert main(["finetune", "--out", str(tmp_path / "empty"), "--resume"]) == 2
    assert not (tmp_path / "empty").exists()


# distillation


@pytest.mark.parametrize("name", PPO_ALONE)
def test_distillation_refuses_what_it_does_not_read(name, run):
    ppo = dataclasses.replace(DistillConfig(generalist=run).ppo, **{name: 0.0021})
    with pytest.raises(InvalidConfig, match=f"^{name} is 0.0021: distillation does not use it, leave it out"):
        DistillConfig(generalist=run, ppo=ppo)


def test_a_constant_learning_rate_is_kept(run, tiny, tmp_path):
    from hotice.learn.distill.dagger import DistillRunner

    fields = {k: v for k, v in vars(tiny(tmp_path / "student")).items()}
    ppo = PpoConfig(steps=8, minibatches=2, learning_rate=5e-3)
    config = DistillConfig(**fields | {"generalist": run, "updates": 1, "perturbed": False, "ppo": ppo})
    DistillRunner(config).train()
    again = DistillRunner(dataclasses.replace(config, resume=True))
    assert rates(again) == [5e-3, 5e-3]
    slower = dataclasses.replace(ppo, learning_rate=1e-4)
    assert rates(DistillRunner(dataclasses.replace(config, resume=True, ppo=slower))) == [1e-4, 1e-4]
