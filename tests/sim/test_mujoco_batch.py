import mujoco
import numpy as np
import pytest
import torch

from hotice.errors import InvalidConfig, UnknownName
from hotice.model import builder
from hotice.model.geometry.shapes import BoxShape
from hotice.model.scene import Obstacle, Scene
from hotice.sim.carry_bank import CarryBank
from hotice.sim.physics.mujoco_batch import MujocoBatch, differing_fields
from hotice.sim.physics.protocol import make_physics


def started(carry, num_envs=4):
    physics = MujocoBatch(carry.models, num_envs, 1)
    which = torch.arange(num_envs) % len(carry.models)
    physics.qpos[:] = carry.qpos[which]
    physics.ctrl[:] = carry.target[which].double()
    physics.forward(torch.arange(num_envs))
    return physics


def test_tensors_share_memory_with_the_simulator(carry):
    physics = started(carry)
    for name in ("qpos", "qvel", "ctrl", "xpos", "xmat", "cvel"):
        bound = {"com": "subtree_com"}.get(name, name)
        assert np.shares_memory(getattr(physics, name).numpy(), physics.batch.bind(bound)), name


def test_writing_the_state_moves_the_simulation(carry):
    physics = started(carry)
    before = physics.xpos.clone()
    physics.qpos[1, 0] += 1.5
    physics.forward(torch.tensor([1]))
    moved = physics.xpos[:, 1] - before[:, 1]
    torch.testing.assert_close(moved[1], torch.tensor([1.5, 0.0, 0.0], dtype=torch.float64))
    assert torch.equal(moved[[0, 2, 3]], torch.zeros(3, 3, dtype=torch.float64))


@pytest.mark.parametrize("forward", [True, False])
def test_a_push_between_steps_acts_as_in_plain_mujoco(carry, forward):
    """Writing qvel without `forward`, as pushes do, is seen by the next step."""
    physics, model = started(carry), carry.models[0]
    data = mujoco.MjData(model)
    data.qpos[:], data.ctrl[:] = physics.qpos[0].numpy(), physics.ctrl[0].numpy()
    mujoco.mj_forward(model, data)
    data.qacc_warmstart[:] = 0
    for push in (0.0, 0.4, -0.3):
        physics.qvel[0, 1] += push
        data.qvel[1] += push
        if forward:
            physics.forward(torch.tensor([0]))
            data.qacc_warmstart[:] = 0
        physics.step(3)
        for _ in range(3):
            mujoco.mj_step(model, data)
        np.testing.assert_array_equal(physics.qpos[0].numpy(), data.qpos)
        np.testing.assert_array_equal(physics.qvel[0].numpy(), data.qvel)


def test_equals_a_plain_step_loop_bit_for_bit_with_each_rows_own_object(carry):
    physics = started(carry, 8)
    plain = []
    for i in range(8):
        data = mujoco.MjData(carry.models[i % 4])
        data.qpos[:], data.ctrl[:] = physics.qpos[i].numpy(), physics.ctrl[i].numpy()
        plain.append((carry.models[i % 4], data))
    generator = torch.Generator().manual_seed(1)
    for _ in range(10):
        physics.ctrl[:] = carry.target[torch.arange(8) % 4].double() + 0.1 * torch.randn(8, 20, generator=generator)
        physics.step(4)
        for i, (model, data) in enumerate(plain):
            data.ctrl[:] = physics.ctrl[i].numpy()
            for _ in range(4):
                mujoco.mj_step(model, data)
            np.testing.assert_array_equal(physics.qpos[i].numpy(), data.qpos)
            np.testing.assert_array_equal(physics.qvel[i].numpy(), data.qvel)
            np.testing.assert_array_equal(physics.actuator_force[i].numpy(), data.actuator_force)
            mujoco.mj_step1(model, data)  # derived tensors describe the new state
            np.testing.assert_array_equal(physics.xpos[i].numpy(), data.xpos)
            np.testing.assert_array_equal(physics.cvel[i].numpy(), data.cvel)
    assert not torch.equal(physics.qpos[0], physics.qpos[1])


@pytest.mark.parametrize("only", [None, [0, 3, 4, 6]])
@pytest.mark.parametrize("exact", [False, True])
def test_a_delayed_target_arrives_in_its_physics_step(carry, states, only, exact):
    """Grouped by delay, and one by one where contacts with obstacles (far away here) are watched."""
    if exact:
        far = Scene("far", obstacles=(Obstacle("block", "ground", BoxShape((0.1, 0.1, 0.1)), (2.0, 0.9, 0.2)),))
        carry = CarryBank.of(states, 0.005, torch.device("cpu"), scene=far)
    physics = started(carry, 7)
    assert (physics.hits is not None) == exact
    plain = []
    for i in range(7):
        data = mujoco.MjData(carry.models[i % 4])
        data.qpos[:], data.ctrl[:] = physics.qpos[i].numpy(), physics.ctrl[i].numpy()
        plain.append((carry.models[i % 4], data))
    physics.only = None if only is None else torch.tensor(only)
    moving = range(7) if only is None else only
    generator = torch.Generator().manual_seed(1)
    delay = torch.tensor([0, 1, 2, 3, 4, 9, 2])
    for _ in range(5):
        target = physics.ctrl + 0.1 * torch.randn(7, 20, generator=generator)
        physics.step(4, target.float(), delay)
        for i in moving:
            model, data = plain[i]
            for k in range(4):
                if k == delay[i]:
                    data.ctrl[:] = target[i].float().numpy()
                mujoco.mj_step(model, data)
            np.testing.assert_array_equal(physics.qpos[i].numpy(), data.qpos)
            np.testing.assert_array_equal(physics.qvel[i].numpy(), data.qvel)
            np.testing.assert_array_equal(physics.ctrl[i].numpy(), data.ctrl)
            if not exact:  # there, the stages that find contacts compute the forces of the new state
                np.testing.assert_array_equal(physics.actuator_force[i].numpy(), data.actuator_force)
    still = [i for i in range(7) if i not in moving]
    assert torch.equal(physics.qpos[still], carry.qpos[torch.tensor(still, dtype=torch.int64) % 4])


def test_only_some_advance_and_the_others_stand_still(carry):
    physics, all_of_them = started(carry), started(carry)
    physics.only = torch.tensor([1, 3])
    before = physics.qpos.clone()
    physics.step(4)
    all_of_them.step(4)
    assert torch.equal(physics.qpos[[0, 2]], before[[0, 2]])
    assert (
        torch.equal(physics.qpos[[1, 3]], all_of_them.qpos[[1, 3]]) and (physics.qpos[[1, 3]] != before[[1, 3]]).any()
    )
    physics.only = None
    physics.step(4)
    assert (physics.qpos[[0, 2]] != before[[0, 2]]).any()


def test_objects_differ_where_models_do(carry):
    names = differing_fields(carry.models)
    assert {"body_mass", "geom_size", "body_quat", "geom_type"} <= set(names)
    assert differing_fields([carry.models[0], carry.models[0]]) == []


def test_set_models_gives_a_row_the_parameters_of_another_model(carry):
    physics, other = started(carry), started(carry)
    physics.set_models(torch.tensor([0]), torch.tensor([1]))
    for p in (physics, other):
        p.qpos[0], p.ctrl[0] = carry.qpos[1], carry.target[1].double()
        p.forward(torch.arange(4))
        p.step(8)
    assert torch.equal(physics.qpos[0], physics.qpos[1])
    assert not torch.equal(other.qpos[0], other.qpos[1])


def test_state_restores_bit_for_bit(carry):
    physics = started(carry)
    physics.step(5)
    saved = physics.state()
    physics.step(5)
    after, force = physics.qpos.clone(), physics.actuator_force.clone()
    physics.load_state(saved)
    assert torch.equal(physics.actuator_force, saved["actuator_force"]) and saved["actuator_force"].abs().max() > 1
    physics.step(5)
    assert torch.equal(physics.qpos, after) and torch.equal(physics.actuator_force, force)


@pytest.mark.parametrize("field, column", [("qvel", 5), ("qpos", 9)])
@pytest.mark.parametrize("value", [float("nan"), float("inf"), 1e12])
def test_a_diverged_row_stays_visible_and_alone(carry, field, column, value):
    physics, fine = started(carry), started(carry)
    getattr(physics, field)[1, column] = value
    physics.step(4)
    fine.step(4)
    rest = [0, 2, 3]
    row = torch.cat([physics.qpos[1], physics.qvel[1]])
    assert not torch.isfinite(row).all() or row.abs().max() > 1e3
    assert torch.equal(physics.qpos[rest], fine.qpos[rest]) and torch.equal(physics.qvel[rest], fine.qvel[rest])
    physics.qpos[1], physics.qvel[1] = fine.qpos[1], 0.0
    physics.forward(torch.tensor([1]))
    assert all(torch.isfinite(getattr(physics, n)).all() for n in ("xpos", "xmat", "cvel", "com", "actuator_force"))
    physics.step(4)
    assert torch.isfinite(physics.qpos).all()


def test_models_of_another_layout_are_refused(carry, states):
    with pytest.raises(InvalidConfig, match="one layout"):
        MujocoBatch([carry.models[0], builder.build_model(None)], 2, 1)
    with pytest.raises(InvalidConfig, match="at least 1"):
        MujocoBatch(carry.models, 0, 1)
    with pytest.raises(UnknownName, match="mujoco"):
        make_physics("bullet", carry.models, 2, "cpu")
