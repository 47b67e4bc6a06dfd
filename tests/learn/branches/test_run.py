"""Runs of branches, each in its process: what they are, to the bit, and what a loss costs."""

import dataclasses
import json
import multiprocessing
import os
import signal
import threading
import time
from pathlib import Path

import pytest
import torch

from hotice.commands.program import main
from hotice.errors import CheckpointError, HoticeError, InvalidConfig, OutputError
from hotice.learn.branches import branch, process
from hotice.learn.branches import run as branches
from hotice.learn.branches.config import BranchConfig
from hotice.learn.branches.each import SEED_STRIDE, anew_config, first_config
from hotice.learn.branches.outer import OuterStep
from hotice.learn.branches.run import BranchedRun, runner_of
from hotice.learn.checkpoints.average import PREFIX
from hotice.learn.checkpoints.checkpoint import list_checkpoints, load_checkpoint
from hotice.learn.checkpoints.merge import merge
from hotice.learn.distill.config import DistillConfig
from hotice.learn.train.runner import Runner
from hotice.owner import sole_owner
from tests.learn.branches import kinds

pytestmark = pytest.mark.slow
BOOK = Path(__file__).parents[2] / "sim" / "data" / "picks.npz"
EACH = 64
"""Environment steps of an update of `tiny`."""


@pytest.fixture(autouse=True)
def quick(monkeypatch):
    """Processes that start fast: forked from one that has imported what they need."""
    multiprocessing.get_context("forkserver").set_forkserver_preload(["hotice.learn.branches.run", "torch._dynamo"])
    monkeypatch.setattr(process, "START", "forkserver")


@pytest.fixture
def split(tiny):
    """Function: options of a run of two branches, a round of two updates."""

    def make(out, every=2, branches=2, momentum=0.0, rate=1.0, **changes):
        config = BranchConfig(
            branches=branches, merge_every=every * EACH, outer_momentum=momentum, outer_learning_rate=rate
        )
        return tiny(out, split=config, **changes)

    return make


def differing(one, two):
    (a, _), (b, _) = load_checkpoint(one), load_checkpoint(two)
    assert set(a) == set(b)
    return [name for name in a if not torch.equal(a[name], b[name])]


def lines(path):
    return [json.loads(line) for line in path.read_text().splitlines()]


def test_one_branch_is_a_plain_run_bit_for_bit(tiny, split, tmp_path):
    """Also where it is averaged, with itself, after two and after four updates."""
    scenes = ("open_floor", "gap")
    Runner(tiny(tmp_path / "plain", updates=5, scenes=scenes)).train()
    config = split(tmp_path / "run", branches=1, updates=5, scenes=scenes)
    assert not config.split.several and isinstance(runner_of(Runner, config), Runner)
    assert BranchedRun(Runner, config).train()
    assert differing(tmp_path / "plain", tmp_path / "run" / "branch-0") == []
    assert [row["update"] for row in lines(tmp_path / "run" / "merges.jsonl")] == [2, 4]
    plain, ours = lines(tmp_path / "plain" / "log.jsonl"), lines(tmp_path / "run" / "log.jsonl")
    same = ("update", "steps", "reward", "episodes", "kl/low", "length")
    assert [{k: r.get(k) for k in same} for r in ours] == [{k: r.get(k) for k in same} for r in plain]
    shown, plain = load_checkpoint(tmp_path / "run"), load_checkpoint(tmp_path / "plain")
    assert all(torch.equal(value, plain[0][name]) for name, value in shown[0].items())
    assert shown[1]["steps"] == plain[1]["steps"] == 5 * EACH and shown[1]["update"] == 5


def test_a_round_of_two_is_the_merge_of_two_runs_with_their_seeds(tiny, split, run, tmp_path):
    for number in (0, 1):
        Runner(tiny(tmp_path / f"hand{number}", init=run, seed=3 + SEED_STRIDE * number)).train()
    by_hand = merge([tmp_path / "hand0", tmp_path / "hand1"], tmp_path / "merged")
    assert BranchedRun(Runner, split(tmp_path / "run", init=run, seed=3)).train()
    for number in (0, 1):
        assert differing(tmp_path / f"hand{number}", tmp_path / "run" / f"branch-{number}") == []
    (merged, _), (ours, meta) = load_checkpoint(by_hand), load_checkpoint(tmp_path / "run")
    kept = [name for name in ours if name.startswith(PREFIX)]
    assert kept and all(torch.equal(ours[name], merged[name]) for name in kept), "what is evaluated"
    hands = [load_checkpoint(tmp_path / f"hand{number}")[0] for number in (0, 1)]
    for name in (n for n in ours if n.startswith("net.nets.")):
        torch.testing.assert_close(ours[name], 0.5 * (hands[0][name] + hands[1][name]), rtol=0, atol=1e-7)
    assert meta["steps"] == 2 * 2 * EACH and meta["update"] == 2 and meta["branches"]["averaged"] == [0, 1]
    assert meta["ancestors"] == load_checkpoint(tmp_path / "hand0")[1]["ancestors"]


def test_momentum_carries_on_from_round_to_round(split, tmp_path):
    config = split(tmp_path / "run", every=1, momentum=0.9, rate=0.7, updates=2)
    assert BranchedRun(Runner, config).train()
    step, velocity = OuterStep(learning_rate=0.7, momentum=0.9), {}
    first, second = list_checkpoints(tmp_path / "run" / "merged")
    assert [f.name[-1] for f in (first, second)] == ["1", "2"]
    before, _ = load_checkpoint(first)
    velocity = {n.removeprefix("outer."): v for n, v in before.items() if n.startswith("outer.")}
    parts = [load_checkpoint(tmp_path / "run" / f"branch-{number}")[0] for number in (0, 1)]
    names = [n for n in before if n.startswith("net.nets.")]
    assert set(velocity) == set(names) and any(v.abs().max() > 1e-4 for v in velocity.values())
    mean = {n: ((parts[0][n].double() + parts[1][n].double()) / 2).float() for n in names}
    after, _ = step(before, mean, velocity)
    ours, _ = load_checkpoint(second)
    for name in names:
        torch.testing.assert_close(ours[name], after[name], rtol=0, atol=1e-7)
    assert "outer.net.nets.low.log_std" not in load_checkpoint(tmp_path / "run")[0]


def test_a_killed_branch_costs_what_it_did_since_the_last_average(split, tmp_path, capsys):
    config = split(tmp_path / "run", updates=6, checkpoint_updates=1)
    assert BranchedRun(kinds.KilledOnce, config).train()
    merges = lines(tmp_path / "run" / "merges.jsonl")
    assert [(row["update"], row["averaged"], row["lost"]) for row in merges] == [
        (2, [0, 1], {}),
        (4, [0], {"1": "killed by SIGKILL"}),
        (6, [0, 1], {}),
    ]
    assert "branch 1 was lost (killed by SIGKILL): left out of the next average" in capsys.readouterr().err
    rows = lines(tmp_path / "run" / "log.jsonl")
    assert [row["update"] for row in rows] == [1, 2, 3, 4, 5, 6] and [row["branches"] for row in rows][3] == 1
    assert load_checkpoint(tmp_path / "run")[1]["update"] == 6
    again = load_checkpoint(tmp_path / "run" / "branch-1")[1]
    assert again["update"] == 6 and again["config"]["seed"] == SEED_STRIDE + 1 + 2, "other draws than the first time"
    alone, average = load_checkpoint(tmp_path / "run" / "branch-0")[0], list_checkpoints(tmp_path / "run" / "merged")[0]
    assert alone and load_checkpoint(average)[1]["branches"]["averaged"] == [0]


def test_a_branch_that_dies_again_and_again_is_left_alone(split, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(branches, "MOST_LOSSES", 1)
    assert BranchedRun(kinds.AlwaysDiverges, split(tmp_path / "run", every=1, updates=3)).train()
    said = capsys.readouterr().err
    assert "branch 1 was lost (its weights are not finite)" in said
    assert "lost 2 times in a row, it is left alone until --resume" in said
    assert [row["averaged"] for row in lines(tmp_path / "run" / "merges.jsonl")] == [[0]] * 3
    assert load_checkpoint(tmp_path / "run")[1]["update"] == 3


def test_when_all_are_lost_the_run_ends_and_says_why(split, tmp_path):
    with pytest.raises(
        HoticeError, match="all branches were lost after update 0 .*branch 0: its weights are not finite"
    ):
        BranchedRun(kinds.NoneLives, split(tmp_path / "run")).train()
    assert load_checkpoint(tmp_path / "run")[1]["update"] == 0


def interrupt_after(path, rows):
    """Sends this process what Ctrl-C would, once a log has so many rows."""

    def watch():
        while not path.exists() or len(path.read_text().splitlines()) < rows:
            time.sleep(0.005)
        os.kill(os.getpid(), signal.SIGINT)

    threading.Thread(target=watch, daemon=True).start()


def test_what_was_limited_interrupted_and_resumed_is_what_was_not(split, tmp_path):
    """Two updates, those before Ctrl-C, then the rest, of rounds of four, the last of which is not whole."""
    whole = split(tmp_path / "whole", every=4, updates=7, momentum=0.6)
    assert BranchedRun(Runner, whole).train()
    out = tmp_path / "parts"
    parts = dataclasses.replace(whole, out=out, resume=True)
    assert BranchedRun(Runner, dataclasses.replace(parts, updates=2)).train()
    shown, meta = load_checkpoint(out)
    each = [load_checkpoint(out / f"branch-{number}")[0] for number in (0, 1)]
    name = "net.nets.up.actor.0.weight"
    torch.testing.assert_close(shown[name], 0.5 * (each[0][name] + each[1][name]), rtol=0, atol=1e-7)
    assert meta["branches"]["updates"] == [2, 2] and meta["steps"] == 2 * 2 * EACH
    interrupt_after(out / "branch-1" / "log.jsonl", 3)
    assert not BranchedRun(Runner, parts).train()
    assert 2 <= load_checkpoint(out)[1]["update"] < 7
    assert BranchedRun(Runner, parts).train()
    for name in ("branch-0", "branch-1", "merged", "."):
        assert differing(tmp_path / "whole" / name, out / name) == [], name
    one, two = (lines(tmp_path / name / "log.jsonl") for name in ("whole", "parts"))
    assert [(r["update"], r["steps"]) for r in two] == [(r["update"], r["steps"]) for r in one]
    assert [r["reward"] for r in two] == pytest.approx([r["reward"] for r in one], abs=2e-5)


def test_a_plain_run_becomes_branches_and_a_plain_run_again(tiny, split, tmp_path, capsys):
    out = tmp_path / "run"
    Runner(tiny(out, updates=1)).train()
    assert BranchedRun(Runner, split(out, updates=3, resume=True)).train()
    assert "branch 1: begins from the average of update 1" in capsys.readouterr().err
    meta = load_checkpoint(out)[1]
    assert meta["steps"] == EACH + 2 * 2 * EACH and meta["branches"]["updates"] == [3, 3]
    alone = Runner(tiny(out, updates=4, resume=True))
    assert "is an average, which has no episodes under way" in alone.notice and alone.train()
    assert load_checkpoint(out)[1]["steps"] == meta["steps"] + EACH
    assert BranchedRun(Runner, split(out, updates=6, resume=True)).train()
    assert load_checkpoint(out)[1]["branches"]["updates"] == [6, 6]


def test_trials_are_of_the_average(tiny, split, tmp_path, capsys):
    BranchedRun(Runner, split(tmp_path / "run", trials=2)).train()
    assert "trials at 0.00 M steps: " in capsys.readouterr().err
    accumulator = pytest.importorskip("tensorboard.backend.event_processing.event_accumulator")
    events = accumulator.EventAccumulator(str(tmp_path / "run" / "tensorboard"))
    events.Reload()
    assert [e.step for e in events.Scalars("trials/success")] == [2 * 2 * EACH]
    assert len(events.Images("trials/ways")) == 1


# what is refused


def test_what_cannot_be_is_said_before_anything_starts(tiny, split, run, tmp_path, monkeypatch):
    with pytest.raises(InvalidConfig, match="branches is 2: a Runner is one process"):
        Runner(split(tmp_path / "a"))
    with pytest.raises(InvalidConfig, match="branches is 2.*a distillation is one process"):
        DistillConfig(generalist=run, split=BranchConfig(branches=2))
    with pytest.raises(CheckpointError, match="gone: no checkpoint here"):
        BranchedRun(Runner, split(tmp_path / "b", init=tmp_path / "gone"))
    monkeypatch.setenv("WORLD_SIZE", "2")
    with pytest.raises(InvalidConfig, match="branches is 2, and torchrun has started 2 ranks"):
        BranchedRun(Runner, split(tmp_path / "c"))


def test_another_run_s_folder_and_another_seed_are_refused(tiny, split, run, tmp_path):
    Runner(tiny(tmp_path / "run", updates=1)).train()
    with pytest.raises(OutputError, match="holds checkpoint-0000001 of an earlier run: give --resume"):
        BranchedRun(Runner, split(tmp_path / "run")).train()
    with pytest.raises(CheckpointError, match="seed is 5, but the run goes on with the draws of seed 0"):
        BranchedRun(Runner, split(tmp_path / "run", resume=True, seed=5))


def test_cores_and_seeds_are_shared_out(split, tmp_path, monkeypatch):
    monkeypatch.setattr("hotice.learn.branches.each.usable_cores", lambda: 7)
    config = split(tmp_path, branches=3, threads=0, trials=3, seed=5)
    one, two = first_config(config, 0), first_config(config, 2)
    assert (one.threads, one.seed, two.seed) == (2, 5, 5 + 2 * SEED_STRIDE)
    assert first_config(dataclasses.replace(config, threads=4), 1).threads == 4
    assert two.out == tmp_path / "branch-2" and not two.split.several and two.trials == 0
    assert anew_config(config, 2, tmp_path, 40).seed == 5 + 2 * SEED_STRIDE + 41


def test_the_command(tiny_options, tmp_path, capsys):
    argv = ["train", "--out", str(tmp_path / "run"), *tiny_options, "--branches", "2", "--merge-every", "64"]
    assert main([*argv, "--updates", "2"]) == 0
    assert "next:" in capsys.readouterr().out
    assert load_checkpoint(tmp_path / "run")[1]["config"]["split"]["merge_every"] == 64
    assert main([*argv, "--updates", "2"]) == 2
    assert "holds checkpoint-0000002 of an earlier run" in capsys.readouterr().err


def test_a_pick_up_is_trained_and_resumed_so_too(tmp_path):
    small = "--num-envs 4 --steps 4 --minibatches 2 --epochs 1 --hidden 16 --critic-hidden 16 --threads 1".split()
    small += ["--picks", str(BOOK)]
    student, out = str(tmp_path / "student"), str(tmp_path / "better")
    assert main(["pickup", "distill", *small, "--aggregate", "1", "--updates", "1", "--out", student]) == 0
    train = ["pickup", "train", *small, "--branches", "2", "--merge-every", "16", "--critic-updates", "0", "--out", out]
    assert main([*train, "--init", student, "--updates", "1"]) == 0
    assert main([*train, "--resume", "--updates", "2"]) == 0
    assert [row["averaged"] for row in lines(tmp_path / "better" / "merges.jsonl")] == [[0, 1]] * 2
    meta = load_checkpoint(tmp_path / "better")[1]
    assert meta["steps"] == 2 * 2 * 16 and meta["config"]["init"] == student
    assert main(["pickup", "distill", *small, "--branches", "2", "--out", str(tmp_path / "none")]) == 2


def hold(folder, held, seconds):
    with sole_owner(folder):
        held.set()
        time.sleep(seconds)


def test_a_branch_waits_for_one_of_a_killed_run_and_gives_up_after_a_while(tmp_path, monkeypatch):
    context = multiprocessing.get_context("forkserver")
    held = context.Event()
    other = context.Process(target=hold, args=(tmp_path, held, 1.0))
    other.start()
    assert held.wait(60.0)
    monkeypatch.setattr(branch, "PATIENCE_S", 0.0)
    with pytest.raises(OutputError, match="is at work in it"), branch.owned_when_free(tmp_path):
        pass
    monkeypatch.setattr(branch, "PATIENCE_S", 60.0)
    with branch.owned_when_free(tmp_path), pytest.raises(OutputError), sole_owner(tmp_path):
        pass
    other.join()


def test_a_branch_whose_run_is_gone_before_it_begins_does_nothing(tiny, tmp_path):
    context = multiprocessing.get_context("forkserver")
    ours, theirs = context.Pipe()
    ours.close()
    # what would be made of the configuration is no runner
    late = context.Process(target=branch.run_branch, args=(int, tiny(tmp_path), theirs, 0))
    late.start()
    late.join(60.0)
    assert late.exitcode == 0 and list_checkpoints(tmp_path) == []
