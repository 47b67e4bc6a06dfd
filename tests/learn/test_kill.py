"""Work that is killed at random moments, again and again, ends bit for bit where undisturbed work ends.

`HOTICE_KILLS=10 pytest tests/learn/test_kill.py` kills each command ten times.
"""

import json
import multiprocessing
import os
import random
import signal
import time
from pathlib import Path

import pytest
import torch
import yaml

from hotice.learn.__main__ import main
from hotice.learn.checkpoint import PREFIX, load_checkpoint
from hotice.learn.jobs import LOCK
from hotice.learn.pipeline_file import load_pipeline
from hotice.learn.policy import load_policy, torch_policy

KILLS = int(os.environ.get("HOTICE_KILLS", "2"))
UPDATES = 4 * KILLS
SMALL = ["--num-envs", "4", "--steps", "4", "--scenes", "open_floor", "gap", "--checkpoint-updates", "1"]
pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def processes():
    """Processes that start fast: forked from one that has imported what they need."""
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["hotice.learn.dagger", "hotice.learn.commands"])
    return context


def survive(processes, argv, achieved, seed, also=lambda: None):
    """Runs a command, kills it `KILLS` times, mostly a while after it has got further, then lets it end.

    `achieved()` gives the set of what is done; `also()` kills what the command had started.
    """
    moments, seen = random.Random(seed), set()
    for _ in range(KILLS):
        process = processes.Process(target=main, args=(argv,))
        process.start()
        deadline = time.monotonic() + 240
        early = moments.random() < 0.25
        while not early and process.is_alive() and not achieved() - seen:
            assert time.monotonic() < deadline, "no progress"
            time.sleep(0.01)
        time.sleep(moments.uniform(0.0, 1.0 if early else 0.3))
        os.kill(process.pid, signal.SIGKILL)
        process.join()
        also()
        assert process.exitcode == -signal.SIGKILL, "it ended before it was killed: more to do is needed"
        seen |= achieved()
    last = processes.Process(target=main, args=(argv,))
    last.start()
    last.join()
    assert last.exitcode in (0, None)


def same(one, other, updates):
    (a, meta_a), (b, meta_b) = load_checkpoint(one), load_checkpoint(other)
    assert meta_a["update"] == meta_b["update"] == updates and set(a) == set(b)
    return [k for k in a if not torch.equal(a[k], b[k])] == []


def half_written(folder):
    return [p for p in folder.rglob("*") if p.name.startswith(".")]


@pytest.mark.parametrize("command", [["train"], ["distill", "--aggregate", "2"]], ids=lambda c: c[0])
def test_a_run_that_was_killed_ends_like_one_that_was_not(command, processes, run, tiny_options, tmp_path):
    stages = ["--curriculum-distance-m", "0.8", "--curriculum-objects", "0.5"]
    argv = [*command, *tiny_options, *SMALL, *stages, "--updates", str(UPDATES), "--resume"]
    if command[0] == "distill":
        argv += ["--generalist", str(run)]
    whole, killed = tmp_path / "whole", tmp_path / "killed"
    assert main([*argv, "--out", str(whole)]) == 0
    survive(processes, [*argv, "--out", str(killed)], lambda: {p.name for p in killed.glob(f"{PREFIX}*")}, seed=0)
    assert same(whole, killed, UPDATES) and half_written(killed) == []
    rows = [json.loads(line)["update"] for line in (killed / "log.jsonl").read_text().splitlines()]
    assert rows == list(range(1, UPDATES + 1)), "each update is in the log once"


def test_an_evaluation_that_was_killed_ends_like_one_that_was_not(processes, onnx_file, tmp_path):
    argv = ["evaluate", "--policy", str(onnx_file), "--scenes", "open_floor", "gap", "--objects", "2", "--threads", "1"]
    argv += ["--rollouts", str(2 * KILLS), "--batch", "1", "--seed", "3"]
    assert main([*argv, "--out", str(tmp_path / "whole.json")]) == 0
    trials = tmp_path / "killed.json.trials"

    def achieved():
        files = [(p.name, json.loads(p.read_text())["blocks"]) for p in trials.glob("scene-*.json")]
        return {(name, block) for name, blocks in files for block in blocks}

    survive(processes, [*argv, "--out", str(tmp_path / "killed.json")], achieved, seed=1)
    assert (tmp_path / "killed.json").read_bytes() == (tmp_path / "whole.json").read_bytes()
    for file in (tmp_path / "whole.json.trials").iterdir():
        assert json.loads((trials / file.name).read_text()) == json.loads(file.read_text())


def test_a_pipeline_whose_machine_dies_ends_like_one_that_was_not_disturbed(processes, tmp_path):
    updates = 16 * KILLS
    tiny = {
        "num_envs": 4, "steps": 4, "minibatches": 2, "hidden": 16, "critic_hidden": 16, "carry_states": 2,
        "episode_s": 0.3, "checkpoint_updates": 1, "updates": updates,
    }  # fmt: skip
    jobs = {
        "teacher": {"command": "train", "options": tiny},
        "policy": {"command": "export", "options": {"policy": "$teacher"}},
    }
    path = tmp_path / "pipeline.yaml"
    path.write_text(yaml.safe_dump({"format": "hotice-pipeline/1", "out": str(tmp_path / "out"), "jobs": jobs}))
    teacher, policy = load_pipeline(path).jobs

    def its_jobs_die_too():
        """As with the machine; those of a pipeline that is killed alone live on, which is tested elsewhere."""
        for lock in (tmp_path / "out").glob(f"*/{LOCK}"):
            try:
                pid = int(lock.read_text())
                if str(lock.parent).encode() in open(f"/proc/{pid}/cmdline", "rb").read():
                    os.kill(pid, signal.SIGKILL)
            except (ValueError, OSError):  # it had not begun, or has ended
                continue

    survive(
        processes, ["pipeline", str(path), "--retries", "0"], lambda: {p.name for p in teacher.folder.glob(f"{PREFIX}*")},
        seed=2, also=its_jobs_die_too,
    )  # fmt: skip
    argv = list(teacher.argv)
    argv[argv.index("--out") + 1] = str(tmp_path / "whole")
    assert main([teacher.command, *argv]) == 0
    assert same(tmp_path / "whole", teacher.folder, updates)
    assert half_written(tmp_path / "out") == []
    obs = torch.randn(32, sum(w for _, w in load_policy(policy.output).meta["layout"]))
    torch.testing.assert_close(
        load_policy(policy.output).act(obs), torch_policy(tmp_path / "whole").act(obs), atol=1e-5, rtol=0
    )


def test_the_processes_of_a_killed_evaluation_end_with_it(processes, onnx_file, tmp_path):
    argv = ["evaluate", "--policy", str(onnx_file), "--scenes", "open_floor", "--objects", "1", "--threads", "2"]
    argv += ["--rollouts", "5000", "--batch", "2", "--out", str(tmp_path / "r.json")]
    process = processes.Process(target=main, args=(argv,))
    process.start()
    deadline = time.monotonic() + 300
    while process.is_alive() and not list((tmp_path / "r.json.trials").glob("scene-*.json")):
        assert time.monotonic() < deadline, "no progress"
        time.sleep(0.05)
    children = [int(pid) for pid in Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()]
    os.kill(process.pid, signal.SIGKILL)
    process.join()
    assert process.exitcode == -signal.SIGKILL and len(children) >= 2
    while left := [pid for pid in children if alive(pid)]:
        assert time.monotonic() < deadline, f"{left} live on"
        time.sleep(0.1)


def alive(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except OSError:
        return False
