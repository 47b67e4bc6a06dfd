"""A tiny trained run that the tests of this folder share."""

import dataclasses

import numba
import pytest
import torch

from hotice.learn.policy import export_onnx, torch_policy
from hotice.learn.train.config import PpoConfig, TrainConfig
from hotice.learn.train.runner import Runner
from hotice.sim import TaskConfig

TINY = [
    "--num-envs",
    "8",
    "--steps",
    "8",
    "--minibatches",
    "2",
    "--hidden",
    "16",
    "--critic-hidden",
    "16",
    "--threads",
    "1",
    "--carry-states",
    "2",
    "--episode-s",
    "0.3",
]


@pytest.fixture(scope="session", autouse=True)
def one_thread():
    """Batches are small here: threads would only wait for each other."""
    torch.set_num_threads(1)
    numba.set_num_threads(1)


@pytest.fixture(autouse=True)
def elsewhere(tmp_path, monkeypatch):
    """Outputs and the simulator's warnings go to a folder of their own."""
    monkeypatch.chdir(tmp_path)


@pytest.fixture(scope="session")
def tiny():
    """Function: a tiny training configuration; the same as the options `TINY`."""

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
    return TINY


@pytest.fixture(scope="session")
def run(tiny, tmp_path_factory):
    """Folder of a run of two updates; leave it as it is."""
    out = tmp_path_factory.mktemp("run")
    Runner(tiny(out)).train()
    return out


@pytest.fixture(scope="session")
def onnx_file(run, tmp_path_factory):
    """Its exported policy; leave it as it is."""
    return export_onnx(torch_policy(run), tmp_path_factory.mktemp("export") / "policy.onnx")


@pytest.fixture(scope="session")
def task_config():
    return TaskConfig
