"""Branches of one run averaged into one checkpoint."""

import shutil

import pytest
import torch

from hotice.commands.program import main
from hotice.errors import CheckpointError, InvalidConfig, OutputError
from hotice.learn.checkpoints.average import PREFIX
from hotice.learn.checkpoints.checkpoint import list_checkpoints, load_checkpoint, save_checkpoint
from hotice.learn.checkpoints.merge import merge
from hotice.learn.policy import torch_policy
from hotice.learn.train.runner import Runner

ACTOR, CRITIC = "nets.low.actor.0.weight", "nets.low.critic.0.weight"


@pytest.fixture
def branches(run, tiny, tmp_path):
    """Two runs that went on from the same one."""
    for seed in (1, 2):
        Runner(tiny(tmp_path / f"branch{seed}", init=run, seed=seed, updates=1)).train()
    return [tmp_path / "branch1", tmp_path / "branch2"]


def test_actors_are_the_mean_and_the_rest_is_the_first_part_s(branches, tmp_path):
    (one, meta), (two, other) = (load_checkpoint(b) for b in branches)
    folder = merge(branches, tmp_path / "merged")
    tensors, told = load_checkpoint(folder)
    assert not torch.equal(one[PREFIX + ACTOR], two[PREFIX + ACTOR])
    for key in (PREFIX + ACTOR, f"net.{ACTOR}"):
        torch.testing.assert_close(tensors[key], 0.5 * (one[PREFIX + ACTOR] + two[PREFIX + ACTOR]), rtol=0, atol=1e-7)
    key = "obs_norm.var"
    torch.testing.assert_close(tensors[f"net.{key}"], 0.5 * (one[PREFIX + key] + two[PREFIX + key]))
    assert torch.equal(tensors[f"net.{CRITIC}"], one[f"net.{CRITIC}"])
    left_out = {name for name in one if name.startswith(("env.", "optimizer.", "reached", "touched", "whole"))}
    assert (
        set(tensors) == set(one) - left_out and left_out and tensors["net.obs_norm.count"] == one["net.obs_norm.count"]
    )
    assert told["merged"] == [{"steps": m["steps"], "sha256": m["sha256"]} for m in (meta, other)]
    assert told["config"] == meta["config"] and told["update"] == meta["update"]


def test_episodes_of_other_ranks_are_left_out_too(branches, tmp_path):
    tensors, meta = load_checkpoint(branches[0])
    own = {k: v for k, v in meta.items() if k not in ("format", "sha256", "update")}
    tensors |= {f"rank1.{k}": v for k, v in tensors.items() if k.startswith("env.") or k == "generator"}
    folder = save_checkpoint(tmp_path / "ranks", meta["update"], tensors, own | {"ranks": 2})
    merged = load_checkpoint(merge([folder.parent, branches[1]], tmp_path / "merged"))[0]
    assert [name for name in merged if "env." in name] == [] and "rank1.generator" in merged


def test_it_acts_and_is_gone_on_with_like_any_other(branches, tiny, tmp_path):
    merge(branches, tmp_path / "merged")
    held = dict(torch_policy(tmp_path / "merged").net.named_parameters())[ACTOR]
    runner = Runner(tiny(tmp_path / "next", init=tmp_path / "merged"))
    assert torch.equal(runner.net.state_dict()[ACTOR], held)
    assert runner.train()


def test_a_run_is_resumed_from_it_with_new_episodes(branches, tiny, tmp_path):
    merge(branches, tmp_path / "merged")
    meta = load_checkpoint(tmp_path / "merged")[1]
    runner = Runner(tiny(tmp_path / "merged", resume=True, seed=1, updates=meta["update"] + 1))
    assert runner.update == meta["update"] and "has no episodes under way: they start anew" in runner.notice
    assert runner.train() and load_checkpoint(tmp_path / "merged")[1]["update"] == meta["update"] + 1


def test_parts_without_an_average_give_their_newest_weights(tiny, tmp_path):
    for seed in (1, 2):
        Runner(tiny(tmp_path / f"{seed}", seed=seed, updates=1, average=0.0)).train()
    tensors = load_checkpoint(merge([tmp_path / "1", tmp_path / "2"], tmp_path / "merged"))[0]
    one, two = (load_checkpoint(tmp_path / name)[0][f"net.{ACTOR}"] for name in "12")
    torch.testing.assert_close(tensors[f"net.{ACTOR}"], 0.5 * (one + two))


def test_an_average_is_made_anew_but_a_run_is_never_touched(branches, run, tmp_path):
    merge(branches, tmp_path / "merged")
    merge(branches[::-1], tmp_path / "merged")
    assert len(list_checkpoints(tmp_path / "merged")) == 1
    before = load_checkpoint(branches[0])[1]["sha256"]
    with pytest.raises(OutputError, match="holds checkpoint-0000001 of an earlier run: give another folder"):
        merge(branches, branches[0])
    assert load_checkpoint(branches[0])[1]["sha256"] == before


def test_branches_in_other_physics_steps_have_a_mean(branches, tmp_path):
    """Coarse steps for most of a run, fine ones for its end: what counts is the control period."""
    tensors, meta = load_checkpoint(branches[1])
    own = {k: v for k, v in meta.items() if k not in ("format", "sha256", "update")}
    own["config"]["task"] |= {"physics_dt_s": 0.01, "substeps": 2}
    coarse = save_checkpoint(tmp_path / "coarse", meta["update"], tensors, own)
    assert merge([branches[0], coarse.parent], tmp_path / "merged").exists()
    own["config"]["task"] |= {"physics_dt_s": 0.01, "substeps": 4}
    slow = save_checkpoint(tmp_path / "slow", meta["update"], tensors, own)
    with pytest.raises(CheckpointError, match="its control period is 0.04, that of .* 0.02"):
        merge([branches[0], slow.parent], tmp_path / "none")


@pytest.mark.parametrize("count", [0, 1])
def test_two_different_parts_are_needed(branches, tmp_path, count):
    with pytest.raises(InvalidConfig, match="two different checkpoints or runs"):
        merge(branches[:1] * (2 * count), tmp_path / "merged")
    assert not (tmp_path / "merged").exists()


@pytest.mark.parametrize(
    "change, said",
    [
        (lambda t, m: m["config"].update(preset="dual_sgf"), "its preset is 'dual_sgf'"),
        (lambda t, m: m["config"].update(hidden=[3]), r"its hidden is \[3\]"),
        (lambda t, m: m["config"]["task"].update(leg_scale_rad=9.0), "its leg_scale_rad is 9.0"),
        (lambda t, m: m["config"]["task"].update(speed_m_s=0.1), "its speed_m_s is 0.1"),
        (lambda t, m: m["config"]["task"].update(resolution_m=0.1), "its resolution_m is 0.1"),
        (lambda t, m: m["layout"].pop(), "its observation is"),
        (lambda t, m: t.update({f"net.{ACTOR}": torch.zeros(2, 2)}), f"has no net.{ACTOR} of the shape"),
        (lambda t, m: t[f"net.{ACTOR}"].fill_(torch.nan), "is not finite"),
        (lambda t, m: m.pop("layout"), "layout missing"),
    ],
)
def test_parts_that_have_no_mean_are_refused(branches, tmp_path, change, said):
    tensors, meta = load_checkpoint(branches[1])
    change(tensors, meta)
    own = {k: v for k, v in meta.items() if k not in ("format", "sha256", "update")}
    shutil.rmtree(branches[1])
    save_checkpoint(branches[1], 1, tensors, own)
    with pytest.raises(CheckpointError, match=said):
        merge(branches, tmp_path / "merged")
    assert not (tmp_path / "merged").exists()


def test_the_command(branches, tmp_path, capsys):
    out = tmp_path / "merged"
    assert main(["merge", "--parts", *map(str, branches), "--out", str(out)]) == 0
    assert capsys.readouterr().out.strip() == str(out / "checkpoint-0000001")
    assert main(["merge", "--parts", str(branches[0]), str(tmp_path / "nowhere"), "--out", str(out)]) == 2
    assert "nowhere: no checkpoint here" in capsys.readouterr().err
