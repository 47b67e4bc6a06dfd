"""Work that is killed at random moments, again and again, ends bit for bit where undisturbed work ends.

By default two kills a command and one of a pipeline, whose stage and moments change from run to run (the seed is in the
header); `HOTICE_KILLS=10 pytest tests/learn/train/test_kill.py` kills each ten times, a pipeline in all stages.
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

from hotice.commands.pipeline.file import load_pipeline
from hotice.commands.pipeline.jobs import LOCK
from hotice.commands.program import main
from hotice.learn.checkpoints.checkpoint import PREFIX, load_checkpoint
from hotice.learn.policy import load_policy, torch_policy
from tests.samples import draw_seed, sample

KILLS = int(os.environ.get("HOTICE_KILLS", "2"))
UPDATES = 8 * KILLS
SMALL = ["--num-envs", "4", "--steps", "4", "--scenes", "open_floor", "gap", "--checkpoint-updates", "1"]
PERTURBED = ["--perturbed", "--scan", "--history", "2", "--goal-stay-s", "0.1"]
pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def processes():
    """Processes that start fast: forked from one that has imported what they need."""
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["hotice.learn.distill.dagger", "hotice.commands.table"])
    return context


def survive(processes, argv, achieved, seed, kills=KILLS, also=lambda: None):
    """Runs a command, kills it so many times, mostly a while after it has got further, then lets it end.

    `achieved(kill)` gives the set of what is done, as far as that kill waits for it; `also()` kills what the command
    had started.
    """
    moments = random.Random(1000 * draw_seed() + seed)
    for kill in range(kills):
        seen = achieved(kill)
        process = processes.Process(target=main, args=(argv,))
        process.start()
        deadline = time.monotonic() + 240
        early = moments.random() < 0.25
        while not early and process.is_alive() and not achieved(kill) - seen:
            assert time.monotonic() < deadline, "no progress"
            time.sleep(0.01)
        time.sleep(moments.uniform(0.0, 1.0 if early else 0.3))
        os.kill(process.pid, signal.SIGKILL)
        process.join()
        also()
        assert process.exitcode == -signal.SIGKILL, "it ended before it was killed: more to do is needed"
    last = processes.Process(target=main, args=(argv,))
    last.start()
    last.join()
    assert last.exitcode in (0, None)


def same(one, other, updates):
    (a, meta_a), (b, meta_b) = load_checkpoint(one), load_checkpoint(other)
    assert meta_a["update"] == meta_b["update"] == updates and set(a) == set(b)
    return [k for k in a if not torch.equal(a[k], b[k])] == []


def checkpoints(folder):
    return {p.name for p in folder.glob(f"{PREFIX}*")}


def blocks(trials):
    files = [(p.name, json.loads(p.read_text())["blocks"]) for p in trials.glob("scene-*.json")]
    return {(name, block) for name, blocks in files for block in blocks}


def half_written(folder):
    return [p for p in folder.rglob("*") if p.name.startswith(".")]


@pytest.mark.parametrize("command", [["train", *PERTURBED], ["distill", "--aggregate", "2"]], ids=lambda c: c[0])
def test_a_run_that_was_killed_ends_like_one_that_was_not(command, processes, run, tiny_options, tmp_path):
    stages = ["--curriculum-distance-m", "0.8", "--curriculum-objects", "0.5"]
    argv = [*command, *tiny_options, *SMALL, *stages, "--updates", str(UPDATES), "--resume"]
    if command[0] == "distill":
        argv += ["--generalist", str(run)]
    whole, killed = tmp_path / "whole", tmp_path / "killed"
    assert main([*argv, "--out", str(whole)]) == 0
    survive(processes, [*argv, "--out", str(killed)], lambda kill: checkpoints(killed), seed=0)
    assert same(whole, killed, UPDATES) and half_written(killed) == []
    rows = [json.loads(line)["update"] for line in (killed / "log.jsonl").read_text().splitlines()]
    assert rows == list(range(1, UPDATES + 1)), "each update is in the log once"


def test_branches_that_lost_their_run_save_and_go_on_like_ones_that_did_not(processes, tiny_options, tmp_path):
    """The run is killed in the middle of a round; its branches end by themselves, and the next one waits for them."""
    argv = ["train", *tiny_options, *SMALL, "--branches", "2", "--merge-every", str(2 * 16), "--outer-momentum", "0.5"]
    argv += ["--updates", str(2 * UPDATES), "--resume"]
    whole, killed = tmp_path / "whole", tmp_path / "killed"
    assert main([*argv, "--out", str(whole)]) == 0
    survive(
        processes, [*argv, "--out", str(killed)], lambda kill: checkpoints(killed), seed=0, kills=max(1, KILLS // 3)
    )
    for name in (".", "merged", "branch-0", "branch-1"):
        assert same(whole / name, killed / name, 2 * UPDATES), name
    rows = [json.loads(line)["update"] for line in (killed / "log.jsonl").read_text().splitlines()]
    assert rows == list(range(1, 2 * UPDATES + 1)) and half_written(killed) == []


@pytest.fixture(scope="module")
def evaluation(onnx_file, tmp_path_factory):
    """Command line of an evaluation without `--threads` and `--out`, and its report when nothing disturbs it."""
    argv = ["evaluate", "--policy", str(onnx_file), "--scenes", "open_floor", "gap", "--objects", "2", "--batch", "1"]
    argv += ["--rollouts", str(3 * KILLS), "--seed", "3"]
    whole = tmp_path_factory.mktemp("evaluation") / "whole.json"
    assert main([*argv, "--threads", "1", "--out", str(whole)]) == 0
    return argv, whole


@pytest.mark.parametrize("threads, kills", [(1, KILLS), (2, max(1, KILLS // 2))], ids=["one", "two"])
def test_an_evaluation_that_was_killed_ends_like_one_that_was_not(threads, kills, processes, evaluation, tmp_path):
    argv, whole = evaluation
    trials = tmp_path / "killed.json.trials"
    argv = [*argv, "--threads", str(threads), "--out", str(tmp_path / "killed.json")]
    survive(processes, argv, lambda kill: blocks(trials), seed=1, kills=kills)
    assert (tmp_path / "killed.json").read_bytes() == whole.read_bytes()
    for file in Path(f"{whole}.trials").iterdir():
        assert json.loads((trials / file.name).read_text()) == json.loads(file.read_text())


def test_a_pipeline_whose_machine_dies_ends_like_one_that_was_not_disturbed(processes, tmp_path):
    """A kill waits for the teacher, the student or the score to get on; several are shared out in this order."""
    kills = KILLS if KILLS > 2 else 1
    updates = 10 * max(3, kills)
    tiny = {
        "num_envs": 4,
        "steps": 4,
        "minibatches": 2,
        "hidden": 16,
        "critic_hidden": 16,
        "carry_states": 2,
        "episode_s": 0.3,
        "checkpoint_updates": 1,
        "updates": updates,
    }
    trials = {"scenes": "open_floor", "objects": 1, "batch": 1, "rollouts": 4 * max(3, kills), "horizon_s": 1.0}
    jobs = {
        "teacher": {"command": "train", "options": tiny},
        "student": {
            "command": "distill",
            "options": {**tiny, "teachers": "$teacher", "init": "$teacher", "aggregate": 2},
        },
        "score": {"command": "evaluate", "options": {"policy": "$student", **trials}},
        "policy": {"command": "export", "options": {"policy": "$student"}},
    }
    path = tmp_path / "pipeline.yaml"
    path.write_text(yaml.safe_dump({"format": "hotice-pipeline/1", "out": str(tmp_path / "out"), "jobs": jobs}))
    jobs = {job.name: job for job in load_pipeline(path).jobs}
    stages = [
        lambda: checkpoints(jobs["teacher"].folder),
        lambda: checkpoints(jobs["student"].folder),
        lambda: blocks(Path(f"{jobs['score'].output}.trials")),
    ]
    if kills < len(stages):
        stages = sample(stages, kills)

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
        processes,
        ["pipeline", str(path), "--retries", "0"],
        lambda kill: stages[kill * len(stages) // kills](),
        seed=2,
        kills=kills,
        also=its_jobs_die_too,
    )
    assert half_written(tmp_path / "out") == []
    # the undisturbed run has the same paths, which reports and checkpoints name
    (tmp_path / "out").rename(tmp_path / "killed")
    for name in ("teacher", "student", "score"):
        jobs[name].folder.mkdir(parents=True)
        assert main([jobs[name].command, *jobs[name].argv]) == 0
    killed = {name: tmp_path / "killed" / job.output.relative_to(tmp_path / "out") for name, job in jobs.items()}
    for name in ("teacher", "student"):
        assert same(jobs[name].output, killed[name], updates), name
    reports = [json.loads(file.read_text()) for file in (killed["score"], jobs["score"].output)]
    for report in reports:
        del report["trained"]["minutes"]  # what training took by the clock
    assert reports[0] == reports[1]
    obs = torch.randn(32, sum(w for _, w in load_policy(killed["policy"]).meta["layout"]))
    expected = torch_policy(jobs["student"].output).act(obs)
    torch.testing.assert_close(load_policy(killed["policy"]).act(obs), expected, atol=1e-5, rtol=0)


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
