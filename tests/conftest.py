"""What tests of several folders share: a folder and threads of their own, objects in hands, a tiny trained run."""

import dataclasses
import os
import signal
import sys

import numba
import numpy as np
import pytest

from hotice.model import Box
from hotice.model.objects import Cylinder, Sphere
from tests.samples import SEED_NAME, draw_seed, split_alone

# Tests read every line that commands say, and not all that they run was compiled before.
os.environ.setdefault("HOTICE_QUIET", "1")

TINY = {
    "num-envs": 8,
    "steps": 8,
    "minibatches": 2,
    "hidden": 16,
    "critic-hidden": 16,
    "threads": 1,
    "carry-states": 2,
    "episode-s": 0.3,
}


def pytest_addoption(parser):
    parser.addoption(
        "--alone", action="store_true", help="only tests that need the machine for themselves, which workers leave out"
    )


def pytest_configure(config):
    """Before workers are started, which take it over."""
    draw_seed()


def pytest_report_header(config):
    return f"samples: {SEED_NAME}={draw_seed()} takes the same again"


def pytest_collection_modifyitems(config, items):
    asked, beside = config.getoption("alone"), hasattr(config, "workerinput")
    items[:], left_out = split_alone(items, lambda item: item.get_closest_marker("alone") is not None, asked, beside)
    if left_out:
        config.hook.pytest_deselected(items=left_out)


@pytest.fixture(scope="session", autouse=True)
def one_thread():
    """Batches are small in tests: threads would only wait for each other."""
    numba.set_num_threads(1)
    # Importing torch here would cost the tests of packages without it a second.
    if "torch" in sys.modules:
        sys.modules["torch"].set_num_threads(1)


@pytest.fixture(scope="session", autouse=True)
def interruptible():
    """A shell has what it starts in the background ignore Ctrl-C, and all that is started from there; tests send it."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(autouse=True)
def elsewhere(tmp_path, monkeypatch):
    """Outputs and the simulator's warnings go to a folder of their own."""
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def rng():
    return np.random.default_rng(0)


@pytest.fixture(scope="session")
def states():
    """Carry states of a light box, a heavy box, a cylinder and a sphere."""
    from hotice.model.carry import solve_carry

    objects = Box((0.3, 0.3, 0.3), 1.0), Box((0.24, 0.36, 0.22), 3.0), Cylinder(0.13, 0.3, 1.5), Sphere(0.14, 1.2)
    return [solve_carry(carried) for carried in objects]


@pytest.fixture(scope="session")
def tiny():
    """Function: a tiny training configuration; the same as the options `TINY`."""
    from hotice.learn.ppo.config import PpoConfig
    from hotice.learn.train.config import TrainConfig

    def make(out, **changes):
        config = TrainConfig(
            out=out,
            num_envs=8,
            updates=2,
            threads=1,
            hidden=(16,),
            critic_hidden=(16,),
            ppo=PpoConfig(steps=8, minibatches=2),
            task=dataclasses.replace(TrainConfig().task, carry_states=2, episode_s=0.3),
        )
        return dataclasses.replace(config, **changes)

    return make


@pytest.fixture(scope="session")
def tiny_options():
    return [word for name, value in TINY.items() for word in (f"--{name}", str(value))]


@pytest.fixture(scope="session")
def run(tiny, tmp_path_factory):
    """Folder of a run of two updates; leave it as it is."""
    from hotice.learn.train.runner import Runner

    out = tmp_path_factory.mktemp("run")
    Runner(tiny(out)).train()
    return out


@pytest.fixture(scope="session")
def onnx_file(run, tmp_path_factory):
    """Its exported policy; leave it as it is."""
    from hotice.learn.export import export_onnx
    from hotice.learn.policy import torch_policy

    return export_onnx(torch_policy(run), tmp_path_factory.mktemp("export") / "policy.onnx")
