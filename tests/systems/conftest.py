"""Small stations and states that the tests of this folder share."""

import numpy as np
import pytest

pytest.importorskip("pydrake")

from hotice.model import Box, load_scene
from hotice.model.carry import solve_carry
from hotice.systems import StationConfig, make_station

BOX = Box((0.3, 0.3, 0.3), 1.5)


@pytest.fixture(scope="session")
def carry():
    return solve_carry(BOX)


@pytest.fixture(scope="session")
def station():
    """MuJoCo, policy, a beam: the one that most tests look at; none changes it."""
    return make_station(StationConfig(scene="beam", log_hz=50.0))


@pytest.fixture(scope="session")
def beam():
    return load_scene("beam")


@pytest.fixture
def robot_state(carry, rng):
    """A robot in motion near the carry state, (84,)."""
    from hotice.model.robot_state import RobotState

    qpos, qvel = RobotState.from_carry(carry).to_mujoco(29)
    qvel = 0.3 * rng.standard_normal(41)
    qpos[7:36] += 0.05 * rng.standard_normal(29)
    qpos[3:7] += 0.1 * rng.standard_normal(4)
    qpos[39:43] += 0.1 * rng.standard_normal(4)
    for quat in (slice(3, 7), slice(39, 43)):
        qpos[quat] /= np.linalg.norm(qpos[quat])
    return np.concatenate([qpos, qvel])


def evaluate(system, output, **inputs):
    """Value of an output port at fixed inputs, and the Context."""
    context = system.CreateDefaultContext()
    for name, value in inputs.items():
        system.GetInputPort(name).FixValue(context, np.asarray(value, dtype=float))
    return system.GetOutputPort(output).Eval(context), context


@pytest.fixture(scope="session")
def run():
    """Function: output of a system at fixed inputs."""
    return lambda system, output, **inputs: evaluate(system, output, **inputs)[0]
