"""MuJoCo Warp against MuJoCo, on the CPU: same states, same task. Kernels are compiled once and cached by Warp."""

import numpy as np
import pytest
import torch

from hotice.errors import InvalidConfig, SimulationError
from hotice.model import load_scene
from hotice.sim import TaskConfig, TransportEnv
from hotice.sim.carry_bank import CarryBank
from hotice.sim.mujoco_batch import MujocoBatch
from hotice.sim.physics import make_physics

pytest.importorskip("mujoco_warp")
pytestmark = [pytest.mark.parity, pytest.mark.slow]
CPU = torch.device("cpu")
DERIVED = ("xpos", "xmat", "cvel", "com")


@pytest.fixture(scope="module")
def shaped(states):
    """Carry states of two boxes, a cylinder and a sphere in models of one layout."""
    return CarryBank.of(states, 0.005, CPU, one_layout=True)


@pytest.fixture(scope="module")
def warp_and_batch(shaped):
    return tuple(make_physics(name, shaped.models, 4, "cpu", 1) for name in ("warp", "mujoco"))


def place(physics, carry):
    """Feet a millimetre into the floor: exactly touching, rounding would decide about contact."""
    ids = torch.arange(physics.num_envs)
    model = ids % len(carry.states)
    physics.set_models(ids, model)
    physics.qpos[:] = carry.qpos[model].to(physics.qpos.dtype)
    physics.qpos[:, 2] -= 0.001
    physics.qpos[:, -5] -= 0.001
    physics.qvel[:] = 0.0
    physics.ctrl[:] = carry.target[model].to(physics.ctrl.dtype)
    physics.forward(ids)


def test_a_delayed_target_arrives_in_the_same_physics_step(warp_and_batch, shaped):
    delay = torch.tensor([0, 1, 3, 4])
    for physics in warp_and_batch:
        place(physics, shaped)
    for sign in (1.0, -1.0, 1.0):
        for physics in warp_and_batch:
            physics.step(4, shaped.target + 0.05 * sign, delay)
    warp, batch = warp_and_batch
    assert torch.equal(warp.ctrl, batch.ctrl.float())
    assert torch.equal(warp.ctrl[3], shaped.target[3]), "a whole control step late: not yet there"
    assert largest_difference(warp.qpos, batch.qpos) < 1e-4
    assert largest_difference(warp.qvel, batch.qvel) < 1e-2


def largest_difference(a, b):
    return float((a.double() - b.double()).abs().max())


def test_states_agree_after_fifty_control_steps(warp_and_batch, shaped):
    generator = torch.Generator().manual_seed(0)
    for physics in warp_and_batch:
        place(physics, shaped)
    for _ in range(50):
        target = shaped.target + 0.01 * torch.randn(4, 20, generator=generator)
        for physics in warp_and_batch:
            physics.ctrl[:] = target.to(physics.ctrl.dtype)
            physics.step(4)
    warp, batch = warp_and_batch
    assert batch.qpos[:, 2].min() > 0.6, "the robots are meant to stand"
    for name in ("qpos", "xpos", "com"):
        assert largest_difference(getattr(warp, name), getattr(batch, name)) < 1e-4, name
    assert largest_difference(warp.xmat, batch.xmat) < 3e-4
    assert largest_difference(warp.actuator_force, batch.actuator_force) < 0.05


def test_derived_tensors_agree_for_any_state(warp_and_batch, shaped):
    generator = torch.Generator().manual_seed(1)
    joints, speed = (0.3 * torch.randn(4, n, generator=generator, dtype=torch.float64) for n in (20, 32))
    for physics in warp_and_batch:
        place(physics, shaped)
        physics.qpos[:, 7:27] += joints.to(physics.qpos.dtype)
        physics.qvel[:] = speed.to(physics.qvel.dtype)
        physics.forward(torch.arange(4))
    warp, batch = warp_and_batch
    for name in DERIVED:
        assert largest_difference(getattr(warp, name), getattr(batch, name)) < 2e-5, name
    assert (warp.actuator_force == 0).all()


def test_each_environment_has_the_parameters_of_its_model(warp_and_batch, shaped):
    """An object that falls freely tells mass only by what holds it: compare the torque of arms that carry it."""
    warp, batch = warp_and_batch
    order = torch.tensor([3, 1, 0, 2])
    for physics in warp_and_batch:
        physics.set_models(torch.arange(4), order)
    for name in ("body_mass", "body_inertia", "geom_size", "body_quat"):
        ours = warp._fields[name].reshape(4, -1)
        wanted = torch.tensor(np.stack([np.ravel(getattr(shaped.models[i], name)) for i in order]), dtype=torch.float32)
        torch.testing.assert_close(ours, wanted, msg=name)
    assert isinstance(batch, MujocoBatch)


def test_a_saved_state_goes_on_as_before(warp_and_batch, shaped):
    warp, _ = warp_and_batch
    place(warp, shaped)
    warp.step(4)
    saved = warp.state()
    warp.step(4)
    after = warp.state()
    warp.load_state(saved)
    warp.step(4)
    for name, value in warp.state().items():
        assert torch.equal(value, after[name]), name


def test_the_task_scores_both_alike(shaped):
    envs = [
        TransportEnv(
            4, [load_scene("gap")], shaped, seed=5, physics=name, config=TaskConfig(start_noise_m=0.02), threads=1
        )
        for name in ("warp", "mujoco")
    ]
    observations = [env.reset()[0] for env in envs]
    torch.testing.assert_close(*observations, atol=2e-4, rtol=0)
    generator = torch.Generator().manual_seed(2)
    ended = torch.zeros(4, dtype=torch.bool)
    for _ in range(40):
        action = 0.1 * torch.randn(4, 20, generator=generator)
        warp, batch = (env.step(action) for env in envs)
        assert torch.equal(warp.outcome, batch.outcome)
        ended |= batch.outcome > 0
        if ended.any():
            break  # a restart draws anew, and both draw alike; the chaos of a fall is no measure
        torch.testing.assert_close(warp.reward, batch.reward, atol=5e-3, rtol=0)
        torch.testing.assert_close(warp.goal_distance, batch.goal_distance, atol=1e-3, rtol=0)


def test_overflowing_buffers_are_raised(shaped):
    from hotice.sim.mujoco_warp import MujocoWarp

    physics = MujocoWarp(shaped.models, 2, "cpu", constraints=24)
    place(physics, shaped)
    with pytest.raises(SimulationError, match="NEFC.*CONSTRAINTS"):
        physics.step(4)


def test_models_that_cannot_share_a_batch_are_refused(carry):
    with pytest.raises(InvalidConfig, match="geom_type.*object_shapes"):
        make_physics("warp", carry.models, 2, "cpu")


def test_obstacles_in_the_models_are_refused(states):
    with_scene = CarryBank.of(states[:1], 0.005, CPU, scene=load_scene("gap"))
    with pytest.raises(InvalidConfig, match="obstacles"):
        make_physics("warp", with_scene.models, 2, "cpu")
