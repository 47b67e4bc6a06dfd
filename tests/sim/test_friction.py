"""Friction as contacts feel it: what `mjData.contact.friction` holds is what was drawn, on both backends."""

import copy

import mujoco
import numpy as np
import pytest
import torch

from hotice.errors import InvalidConfig
from hotice.model import Box, builder
from hotice.model.carry import Posture, solve_carry
from hotice.model.dynamics import (
    PAPER_DYNAMICS,
    ROBOT_DYNAMICS,
    STUDENT_DYNAMICS,
    DynamicsConfig,
    friction_groups,
    perturb,
)
from hotice.sim.carry_bank import CarryBank
from hotice.sim.physics.mujoco_batch import MujocoBatch

ROBOTS = 300
CPU = torch.device("cpu")


@pytest.fixture(scope="module")
def state():
    return solve_carry(Box((0.3, 0.3, 0.3), 1.5), Posture())


@pytest.fixture(scope="module")
def model(state):
    return builder.build_model(state.carried, wrist_pos=state.wrist_pos)


@pytest.fixture(scope="module")
def robots(model):
    return [perturb(model, ROBOT_DYNAMICS, np.random.default_rng([7, i])) for i in range(ROBOTS)]


def leaning(model, state):
    """Configuration with soles a millimetre in the floor and the object a millimetre in the chest."""
    data = mujoco.MjData(model)
    data.qpos[:] = state.qpos()
    mujoco.mj_kinematics(model, data)
    chest = data.geom("torso_link_0").xpos[0] + model.geom("torso_link_0").size[0]
    data.qpos[-7] = chest + state.carried.half_extents_m[0] - 0.001
    data.qpos[[2, -5]] -= 0.001
    return data.qpos.copy()


def felt(model, state):
    """Friction of each contact of a configuration, by group: left foot, right foot, palms, object against the trunk."""
    data = mujoco.MjData(model)
    data.qpos[:] = leaning(model, state)
    mujoco.mj_forward(model, data)
    return groups(model, [(c.geom, c.friction) for c in data.contact])


def groups(model, contacts):
    found = {"left": [], "right": [], "palms": [], "trunk": []}
    for geom, friction in contacts:
        names = " ".join(model.geom(int(g)).name for g in geom)
        assert friction[0] == friction[1], "isotropic"
        if "sole" in names and "floor" in names:
            found["left" if "left" in names else "right"].append(friction[0])
        elif "palm" in names and "object" in names:
            found["palms"].append(friction[0])
        elif "object" in names and "torso" in names:
            found["trunk"].append(friction[0])
    return found


def assert_uniform(values, low, high):
    """Mean, spread and range of a uniform draw, to four standard errors."""
    n, span = len(values), high - low
    assert low - 1e-6 <= min(values) and max(values) <= high + 1e-6
    assert min(values) < low + 0.05 * span and max(values) > high - 0.05 * span
    assert np.mean(values) == pytest.approx((low + high) / 2, abs=4 * span / np.sqrt(12 * n))
    assert np.std(values) == pytest.approx(span / np.sqrt(12), rel=4 / np.sqrt(2.5 * n))


def check(found):
    """Of all robots: spread within a foot and within the palms 0, draws uniform in what is configured, feet apart."""
    for part in ("left", "right", "palms", "trunk"):
        assert all(len(f[part]) > 0 for f in found), part
        assert max(np.ptp(f[part]) for f in found) == 0.0, part
    assert all(len(f["palms"]) == 8 for f in found)
    left, right = (np.array([f[side][0] for f in found]) for side in ("left", "right"))
    assert_uniform(np.concatenate([left, right]), *ROBOT_DYNAMICS.sole_friction)
    assert abs(np.corrcoef(left, right)[0, 1]) < 4 / np.sqrt(ROBOTS), "each foot has a draw of its own"
    assert_uniform([f["palms"][0] for f in found], *ROBOT_DYNAMICS.palm_friction)
    assert_uniform([f["trunk"][0] for f in found], *ROBOT_DYNAMICS.object_friction)


def test_contacts_feel_what_was_drawn(robots, state):
    check([felt(m, state) for m in robots])


def test_contacts_of_the_batch_feel_what_was_drawn(robots, state):
    """The rows that `mujoco.batch` steps each simulation with, also after they were dealt out anew."""
    physics = MujocoBatch(robots, ROBOTS, threads=1)
    order = torch.randperm(ROBOTS, generator=torch.Generator().manual_seed(1))
    physics.set_models(torch.arange(ROBOTS), order)
    probe, found = copy.copy(robots[0]), []
    for row in range(ROBOTS):
        probe.geom_friction[:] = physics._fields["geom_friction"][row].reshape(probe.geom_friction.shape)
        found.append(felt(probe, state))
        assert found[-1] == felt(robots[int(order[row])], state)
    check(found)


def test_palms_of_a_batch_act(model, state):
    """Of two robots the one with slippery palms drops the object."""
    models = [perturb(model, DynamicsConfig(palm_friction=(f, f)), np.random.default_rng(0)) for f in (0.05, 2.0)]
    physics = MujocoBatch(models, 2, threads=1)
    physics.qpos[:] = torch.tensor(np.stack([state.qpos()] * 2))
    physics.ctrl[:] = torch.tensor(state.joint_target)
    physics.forward(torch.arange(2))
    before = physics.qpos[:, -5].clone()
    physics.step(100)
    fell = before - physics.qpos[:, -5]
    assert fell[0] > 0.2 and abs(fell[1]) < 0.02


@pytest.mark.slow
@pytest.mark.parity
def test_contacts_of_warp_feel_what_was_drawn(robots, state):
    pytest.importorskip("mujoco_warp")
    from hotice.sim.physics.mujoco_warp import MujocoWarp

    physics = MujocoWarp(robots, ROBOTS, "cpu")
    physics.qpos[:] = torch.tensor(leaning(robots[0], state), dtype=torch.float32)
    physics.ctrl[:] = torch.tensor(state.joint_target, dtype=torch.float32)
    physics.step(1)
    contact = physics._d.contact
    count = int(physics._d.nacon.numpy()[0])
    world, geom, friction = (a.numpy()[:count] for a in (contact.worldid, contact.geom, contact.friction))
    found = [groups(robots[0], zip(geom[world == w], friction[world == w], strict=True)) for w in range(ROBOTS)]
    check(found)
    exact = [felt(m, state) for m in robots]
    for part in ("left", "right", "palms", "trunk"):
        np.testing.assert_allclose([f[part][0] for f in found], [f[part][0] for f in exact], rtol=1e-6)


def test_the_floor_has_no_say(model, state):
    """Contacts of soles feel the soles, whatever the floor is made of."""
    out = copy.copy(model)
    out.geom("floor").friction[0] = 5.0
    assert {v for side in ("left", "right") for v in felt(out, state)[side]} == {1.0}


def test_nothing_else_carries_the_draws(model):
    """Friction of the geoms outside the groups stays as described."""
    out = perturb(model, STUDENT_DYNAMICS, np.random.default_rng(0))
    drawn = {i for _, geoms in friction_groups(model) for i in geoms}
    rest = [i for i in range(model.ngeom) if i not in drawn]
    np.testing.assert_array_equal(out.geom_friction[rest], model.geom_friction[rest])
    assert len(drawn) == 8 + 8 + 1


def test_the_protocols_differ_in_what_is_said_of_them():
    assert ROBOT_DYNAMICS.palm_friction == (0.6, 1.2) and ROBOT_DYNAMICS.sole_friction == (0.5, 1.2)
    assert ROBOT_DYNAMICS.torso_com_m == 0.1 and PAPER_DYNAMICS.torso_com_m == 0.05
    assert PAPER_DYNAMICS.palm_friction == (2.0, 2.0)


@pytest.mark.parametrize(
    "bad", [(0.0, 1.0), (1.2, 0.6), (0.5,), (float("nan"), 1.0), "ab", 0.8, ("a", 1.0), (0.5, 99.0)]
)
def test_impossible_ranges_are_refused(bad):
    with pytest.raises(InvalidConfig, match="palm_friction"):
        DynamicsConfig(palm_friction=bad)


def test_a_range_from_a_file_is_a_list():
    assert DynamicsConfig(sole_friction=[0.5, 1]).sole_friction == (0.5, 1.0)


def test_objects_of_several_shapes_share_the_draw(states):
    bank = CarryBank.of(states, 0.005, CPU, one_layout=True, dynamics=ROBOT_DYNAMICS, seed=1)
    for m in bank.models:
        of_object = [m.geom_friction[i, 0] for i in range(m.ngeom) if m.geom(i).name.startswith("object")]
        assert len(of_object) == 3 and len(set(of_object)) == 1
