import dataclasses
import json
import os
import shutil
import signal
import subprocess
import sys
import time

import pytest
import torch

from hotice.errors import CheckpointError, OutputError
from hotice.learn.checkpoints.checkpoint import (
    META,
    TENSORS,
    list_checkpoints,
    load_checkpoint,
    save_checkpoint,
    sha256,
)
from hotice.learn.train.runner import Runner


def newest(out):
    return load_checkpoint(out)[0]


def differing(a, b):
    assert set(a) == set(b)
    return [k for k in a if not torch.equal(a[k], b[k])]


def test_a_run_writes_what_it_needs(run, tiny):
    names = {p.name for p in run.iterdir()}
    assert {"config.json", "log.jsonl", "tensorboard", "checkpoint-0000002"} <= names
    rows = [json.loads(line) for line in (run / "log.jsonl").read_text().splitlines()]
    assert [r["update"] for r in rows] == [1, 2] and rows[-1]["steps"] == 2 * 64
    meta = load_checkpoint(run)[1]
    assert meta["steps"] == 128 and meta["config"]["num_envs"] == 8


def test_learning_changes_every_network(run, tiny, tmp_path):
    before = Runner(tiny(tmp_path / "x")).net.state_dict()
    after = newest(run)
    for agent in ("low", "up"):
        for part in ("actor.0.weight", "critic.0.weight", "log_std"):
            key = f"nets.{agent}.{part}"
            assert not torch.equal(before[key], after[f"net.{key}"]), key


def test_two_and_two_updates_are_four_bit_for_bit(tiny, tmp_path):
    scenes = ("open_floor", "gap")
    Runner(tiny(tmp_path / "whole", updates=4, scenes=scenes)).train()
    Runner(tiny(tmp_path / "parts", updates=2, scenes=scenes)).train()
    Runner(tiny(tmp_path / "parts", updates=4, scenes=scenes, resume=True)).train()
    a, b = newest(tmp_path / "whole"), newest(tmp_path / "parts")
    assert differing(a, b) == []
    Runner(tiny(tmp_path / "other", updates=4, scenes=scenes, seed=1)).train()
    assert differing(a, newest(tmp_path / "other")) != []


def test_a_run_that_goes_on_as_it_was_says_nothing(run, tiny, tmp_path):
    shutil.copytree(run, tmp_path / "run")
    assert Runner(tiny(tmp_path / "run", resume=True)).notice == ""


@pytest.mark.parametrize(
    "changes, words",
    [
        (dict(num_envs=4), "other num_envs: episodes start anew, 2 of 2"),
        (dict(scenes=("beam", "gap")), "other scenes: episodes start anew, 1 of 2"),
        (dict(goal_stay_s=0.1), "other task: episodes start anew, 2 of 2"),
        (dict(perturbed=True), "other perturbed: episodes start anew, 2 of 2"),
    ],
    ids=lambda x: next(iter(x)) if isinstance(x, dict) else "",
)
def test_a_run_that_goes_on_elsewhere_keeps_networks_and_the_rates_of_known_scenes(
    tiny, tmp_path, capfd, changes, words
):
    config = tiny(tmp_path / "run", updates=1, scenes=("open_floor", "gap"))
    first = Runner(config)
    first.curriculum.rate.copy_(torch.tensor([0.9, 0.2]))
    first.save()
    before = newest(tmp_path / "run")
    if "goal_stay_s" in changes:
        changes = dict(task=dataclasses.replace(config.task, **changes))
    config = dataclasses.replace(config, resume=True, **changes)
    second = Runner(config)
    known = dict(zip(("open_floor", "gap"), before["curriculum"], strict=True))
    rates = torch.tensor([float(known.get(name, 0.5)) for name in config.scenes])
    assert torch.equal(second.curriculum.rate, rates)
    assert torch.equal(second.env.starter.scene_weight, second.curriculum.weights())
    assert all(torch.equal(value, before[f"net.{key}"]) for key, value in second.net.state_dict().items())
    anew = Runner(dataclasses.replace(config, resume=False))
    assert torch.equal(second.obs, anew.obs), "episodes start as those of a new run"
    capfd.readouterr()
    second.train()
    assert [words in line for line in capfd.readouterr().err.splitlines()].count(True) == 1


def command(out, options, *more):
    return [sys.executable, "-m", "hotice.learn", "train", "--out", str(out), *options, *more]


def test_resuming_through_the_command_line_is_bit_for_bit_too(tiny_options, tiny, tmp_path):
    Runner(tiny(tmp_path / "whole", updates=3)).train()
    Runner(tiny(tmp_path / "parts", updates=1)).train()
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    subprocess.run(
        command(tmp_path / "parts", tiny_options, "--updates", "3", "--resume"),
        check=True,
        env=environment,
        timeout=300,
    )
    assert differing(newest(tmp_path / "whole"), newest(tmp_path / "parts")) == []


def test_a_new_run_leaves_an_earlier_one_alone(run, tiny, tmp_path):
    """Else the newest checkpoint, which has the higher number, would be the old run's."""
    out = tmp_path / "run"
    shutil.copytree(run, out)
    before = {p: p.read_bytes() for p in out.rglob("*") if p.is_file()}
    with pytest.raises(OutputError, match="holds checkpoint-0000002 of an earlier run: give --resume"):
        Runner(tiny(out, updates=1, seed=3)).train()
    assert {p: p.read_bytes() for p in out.rglob("*") if p.is_file()} == before


def test_a_killed_run_goes_on_from_its_last_checkpoint(tiny_options, tiny, tmp_path):
    out = tmp_path / "run"
    with open(tmp_path / "output", "wb") as sink:
        process = subprocess.Popen(
            command(out, tiny_options, "--updates", "100000", "--checkpoint-updates", "1"), stdout=sink, stderr=sink
        )
        deadline = time.monotonic() + 240
        while (
            time.monotonic() < deadline
            and process.poll() is None
            and not any(int(p.name[-7:]) >= 3 for p in list_checkpoints(out))
        ):
            time.sleep(0.02)
        process.send_signal(signal.SIGKILL)
        assert process.wait() == -signal.SIGKILL, (tmp_path / "output").read_text()
    last = load_checkpoint(out)[1]["update"]
    assert last >= 2
    runner = Runner(tiny(out, updates=last + 1, resume=True))
    assert runner.update == last
    runner.train()
    assert [int(p.name[-7:]) for p in list_checkpoints(out)][-1] == last + 1
    assert not list(out.glob(".checkpoint-*")), "nothing half-written remains"


def test_init_takes_the_learner_but_not_the_counters(run, tiny, tmp_path):
    runner = Runner(tiny(tmp_path / "next", init=run, scenes=("gap",)))
    saved = newest(run)
    assert runner.update == 0 and runner.steps == 0
    assert torch.equal(runner.net.nets["low"].log_std, saved["average.nets.low.log_std"])
    index = next(k for k in saved if k.startswith("optimizer.") and k.endswith("exp_avg"))
    state = runner.algo.optimizer.state_dict()["state"][int(index.split(".")[1])]
    assert torch.equal(state["exp_avg"], saved[index])


@pytest.mark.parametrize(
    "changes, message",
    [
        (dict(preset="single_hodpf"), "trained as 'dual_hodpf'"),
        (dict(hidden=(17,)), "give --hidden 16 --critic-hidden 16$"),
    ],
)
def test_a_checkpoint_of_another_kind_is_refused(run, tiny, tmp_path, changes, message):
    with pytest.raises(CheckpointError, match=message) as caught:
        Runner(tiny(tmp_path, init=run, **changes))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("key", ["layout", "learning_rates", "config"])
def test_a_checkpoint_that_lacks_something_is_refused(run, tiny, tmp_path, key):
    tensors, meta = load_checkpoint(run)
    meta = {k: v for k, v in meta.items() if k not in (key, "format", "sha256", "update")}
    save_checkpoint(tmp_path / "old", 1, tensors, meta)
    with pytest.raises(CheckpointError, match=f"no checkpoint of this version: KeyError '{key}'"):
        Runner(tiny(tmp_path / "old", resume=True))


def test_hash_is_of_the_tensors(run):
    folder = list_checkpoints(run)[-1]
    assert json.loads((folder / META).read_text())["sha256"] == sha256(folder / TENSORS)
