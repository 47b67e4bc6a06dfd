"""Runs that are killed at random moments, again and again, end bit for bit where an undisturbed run ends."""

import multiprocessing
import os
import random
import signal
import time

import pytest
import torch

from hotice.learn.__main__ import main
from hotice.learn.checkpoint import PREFIX, load_checkpoint

KILLS = int(os.environ.get("HOTICE_KILLS", "3"))
UPDATES = 4 * KILLS
SMALL = ["--num-envs", "4", "--steps", "4", "--scenes", "open_floor", "gap", "--checkpoint-updates", "1"]


@pytest.fixture(scope="module")
def processes():
    """Processes that start fast: forked from one that has imported what they need."""
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["hotice.learn.dagger", "hotice.learn.commands"])
    return context


def survive(processes, argv, out, seed):
    """Runs a command, kills it `KILLS` times a while after it has got further, then lets it end."""
    moments, seen = random.Random(seed), set()
    for _ in range(KILLS):
        process = processes.Process(target=main, args=(argv,))
        process.start()
        deadline = time.monotonic() + 120
        while process.is_alive() and not (new := {p.name for p in out.glob(f"{PREFIX}*")} - seen):
            assert time.monotonic() < deadline, "no progress"
            time.sleep(0.01)
        time.sleep(moments.uniform(0.0, 0.3))
        os.kill(process.pid, signal.SIGKILL)
        process.join()
        assert process.exitcode == -signal.SIGKILL, "it ended before it was killed: more updates are needed"
        seen |= new
    last = processes.Process(target=main, args=(argv,))
    last.start()
    last.join()


@pytest.mark.slow
@pytest.mark.parametrize("command", [["train"], ["distill", "--aggregate", "2"]], ids=lambda c: c[0])
def test_a_run_that_was_killed_ends_like_one_that_was_not(command, processes, run, tiny_options, tmp_path):
    argv = [*command, *tiny_options, *SMALL, "--updates", str(UPDATES), "--resume"]
    if command[0] == "distill":
        argv += ["--generalist", str(run)]
    assert main([*argv, "--out", str(tmp_path / "whole")]) == 0
    survive(processes, [*argv, "--out", str(tmp_path / "killed")], tmp_path / "killed", seed=0)
    (a, meta_a), (b, meta_b) = (load_checkpoint(tmp_path / name) for name in ("whole", "killed"))
    assert meta_a["update"] == meta_b["update"] == UPDATES and set(a) == set(b)
    assert [k for k in a if not torch.equal(a[k], b[k])] == []
    assert not list((tmp_path / "killed").glob(f".{PREFIX}*")), "nothing half-written remains"
