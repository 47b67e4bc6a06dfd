"""One environment of every object shape, in scenes with obstacles, after some random actions."""

import pytest
import torch

from hotice.fields.bank import FieldBank
from hotice.model import Box, load_scenes
from hotice.model.carry import solve_carry
from hotice.model.objects import Cylinder, Sphere
from hotice.sim import TaskConfig, TransportEnv
from hotice.sim.carry_bank import CarryBank


@pytest.fixture(scope="session")
def states():
    return [solve_carry(o) for o in (Box((0.3, 0.3, 0.3), 1.0), Cylinder(0.13, 0.3, 1.5), Sphere(0.14, 1.2))]


@pytest.fixture(scope="session")
def bank():
    return FieldBank.build(load_scenes(["beam", "gap", "pillars", "pipe"]))


@pytest.fixture
def make_env(bank, states):
    def make(preset="dual_hodpf", steps=6, bank=bank, **config):
        carry = CarryBank.of(states, 0.005, torch.device("cpu"))
        task = TaskConfig(**{"anywhere": 0.7, "collisions": False, **config})
        env = TransportEnv(24, bank, carry, preset, seed=3, config=task, threads=1)
        env.reset()
        generator = torch.Generator().manual_seed(1)
        for _ in range(steps):
            env.step(0.5 * torch.randn(24, 20, generator=generator))
        return env

    return make
