"""Small environments that the tests of this folder share."""

import dataclasses

import pytest
import torch

from hotice.fields.bank import FieldBank
from hotice.model import load_scenes
from hotice.sim import TaskConfig, TransportEnv
from hotice.sim.carry_bank import CarryBank

CPU = torch.device("cpu")


@pytest.fixture(scope="session")
def carry(states):
    return CarryBank.of(states, 0.005, CPU)


@pytest.fixture(scope="session")
def bank():
    return FieldBank.build(load_scenes(["open_floor", "gap", "pillars"]))


@pytest.fixture(scope="session")
def make_env(bank, carry):
    def make(num_envs=8, preset="dual_hodpf", seed=0, carry=carry, bank=bank, **config):
        return TransportEnv(num_envs, bank, carry, preset, seed=seed, config=TaskConfig(**config), threads=1)

    return make


@pytest.fixture(scope="session")
def shared_env(make_env):
    return make_env()


@pytest.fixture
def env(shared_env):
    """Eight environments just started; each test sees the same ones."""
    shared_env.generator.manual_seed(0)
    shared_env.memory.model[:] = torch.arange(8) % 4
    shared_env.starter.scene_weight[:] = 1.0
    shared_env.unstable = 0
    shared_env.reset()
    return shared_env


@pytest.fixture
def moving(env):
    """The same after a few random actions."""
    generator = torch.Generator().manual_seed(3)
    for _ in range(4):
        env.step(0.5 * torch.randn(8, 20, generator=generator))
    return env


@pytest.fixture(scope="session")
def altered():
    """Function: a snapshot with some attributes replaced."""

    def alter(snapshot, **values):
        return dataclasses.replace(snapshot, **values)

    return alter
