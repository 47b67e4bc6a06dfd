"""`hotice play --view`: what does not fit is refused by name, the address is told, Ctrl-C ends all of it."""

import http.client
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from hotice.commands.configs import PlayConfig
from hotice.commands.live.play_view import Follower, openers
from hotice.commands.program import main
from hotice.errors import InvalidConfig
from hotice.learn.checkpoints.checkpoint import list_checkpoints
from hotice.learn.policy import torch_policy


@pytest.mark.parametrize(
    ("options", "why"),
    [
        ({"rollouts": 3}, "rollouts is 3: nothing is recorded with view"),
        ({"out": Path("x.html")}, "out is 'x.html': nothing is recorded with view"),
        ({"video": Path("x.mp4")}, "video is 'x.mp4': nothing is recorded with view"),
        ({"protocol": "paper"}, "protocol is 'paper'"),
        ({"controller": "walk"}, "controller is 'walk': a live view shows a policy"),
        ({"failures_first": False}, "failures_first is False"),
        ({"seconds": 3.0}, "seconds is 3.0"),
        ({"moving": "still"}, "moving is 'still': a live view's fields follow what moves"),
        ({"view_port": 99999}, "view_port is 99999: a whole number from 0 to 65,535"),
    ],
)
def test_what_does_not_fit_is_refused_by_name(options, why):
    with pytest.raises(InvalidConfig, match=why):
        PlayConfig(view=True, **options)


def test_a_port_needs_a_view():
    with pytest.raises(InvalidConfig, match="view_port is 8000: there is no page without view"):
        PlayConfig(view_port=8000)


def test_a_set_of_scenes_is_refused(capsys):
    assert main(["play", "--view", "--scenes", "bench20"]) == 2
    assert capsys.readouterr().err == "hotice: 20 scenes are given: a live view shows one\n"


def test_a_run_walks_by_its_newest_checkpoint(run, tmp_path):
    """A checkpoint acts as its policy does; a new one is handed over once, and a damaged one is told."""
    copy = tmp_path / "run"
    shutil.copytree(run, copy)
    network, policy = openers(str(copy))[str(copy)](), torch_policy(copy)
    observation = np.random.default_rng(0).normal(size=(1, sum(n for _, n in network.layout))).astype(np.float32)
    np.testing.assert_array_equal(network.run(observation), policy.act(torch.from_numpy(observation)).numpy())
    assert list(openers("student")) == ["student", "carry", "teacher"]
    given, said = [], []
    follower = Follower(copy, SimpleNamespace(order=given.append), said.append)
    follower.look()
    assert given == [] == said
    (newest,) = list_checkpoints(copy)[-1:]
    new = newest.with_name("checkpoint-000090")
    shutil.copytree(newest, new)
    follower.look()
    follower.look()
    assert [network.name for network in given] == [str(new)] and said == [f"loaded {new}"]
    broken = newest.with_name("checkpoint-000091")
    shutil.copytree(newest, broken)
    (broken / "meta.json").write_text("{")
    follower.look()
    assert len(given) == 1 and said[1].startswith(f"{broken} is not shown: ")


def children(pid):
    return [int(p) for p in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


@pytest.mark.slow
def test_the_address_is_told_and_ctrl_c_ends_all():
    command = [sys.executable, "-m", "hotice", "play", "--view", "--scene", "gap", "--no-perturbed"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        line = process.stdout.readline()
        host, port = re.fullmatch(r"live view: http://(127\.0\.0\.1):(\d+)/ \(Ctrl-C ends\)\n", line).groups()
        workers = children(process.pid)
        assert workers
        connection = http.client.HTTPConnection(host, int(port), timeout=60)
        connection.request("GET", "/")
        page = connection.getresponse().read().decode()
        assert "<title>hotice live view</title>" in page and 'id="steer"' in page
        connection.request("GET", "/events")
        stream = connection.getresponse()
        frames = (json.loads(text[6:]) for text in iter(stream.readline, b"") if text.startswith(b"data"))
        assert any(frame["time"] > 0.2 and frame["mode"] == "walking" for frame in frames)
        process.send_signal(signal.SIGINT)
        said = process.communicate(timeout=60)
        assert (process.returncode, said) == (130, ("", "hotice: interrupted\n"))
        end = time.monotonic() + 10
        while any(os.path.exists(f"/proc/{pid}") for pid in workers) and time.monotonic() < end:
            time.sleep(0.05)
        assert not [pid for pid in workers if os.path.exists(f"/proc/{pid}")]
    finally:
        process.kill()
        process.communicate()
