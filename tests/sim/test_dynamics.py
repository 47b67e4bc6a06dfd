import mujoco
import numpy as np
import pytest
import torch

from hotice.errors import InvalidConfig
from hotice.model import g1, load_scenes
from hotice.model.dynamics import STUDENT_DYNAMICS, DynamicsConfig, joint_offset, perturb
from hotice.sim.carry_bank import CarryBank
from hotice.sim.physics.mujoco_batch import differing_fields


@pytest.fixture(scope="module")
def model(carry):
    return carry.models[0]


def drawn(model, seed=0, **config):
    return perturb(model, DynamicsConfig(**config), np.random.default_rng(seed))


def test_zero_spread_changes_nothing(model):
    assert DynamicsConfig().nominal
    assert differing_fields([model, drawn(model)]) == []


def test_the_given_model_is_left_alone(model):
    before = model.body_mass.copy(), model.actuator_gainprm.copy()
    drawn(model, **vars(STUDENT_DYNAMICS))
    np.testing.assert_array_equal(model.body_mass, before[0])
    np.testing.assert_array_equal(model.actuator_gainprm, before[1])


def test_same_seed_same_robot(model):
    spread = vars(STUDENT_DYNAMICS)
    assert differing_fields([drawn(model, 3, **spread), drawn(model, 3, **spread)]) == []
    assert "body_mass" in differing_fields([drawn(model, 3, **spread), drawn(model, 4, **spread)])


def test_gains_scale_within_the_share_and_stay_a_servo(model):
    out = drawn(model, gain=0.25)
    ratio = out.actuator_gainprm[:, 0] / model.actuator_gainprm[:, 0]
    assert (np.abs(ratio - 1) <= 0.25).all() and np.ptp(ratio) > 0.1
    np.testing.assert_allclose(out.actuator_biasprm[:, 1], -out.actuator_gainprm[:, 0])
    assert (out.actuator_forcerange == model.actuator_forcerange).all()


def test_strength_scales_torque_limits(model):
    out = drawn(model, motor_strength=0.1)
    ratio = out.actuator_forcerange[:, 1] / model.actuator_forcerange[:, 1]
    assert (np.abs(ratio - 1) <= 0.1).all() and np.ptp(ratio) > 0.05
    np.testing.assert_allclose(out.actuator_gainprm[:, 0], ratio * model.actuator_gainprm[:, 0])


def test_masses_move_with_their_inertia_and_derived_constants_follow(model):
    out = drawn(model, mass=0.1, torso_mass_kg=1.0, torso_com_m=0.05, payload=0.1)
    ratio = out.body_mass[1:] / model.body_mass[1:]
    np.testing.assert_allclose(out.body_inertia[1:], ratio[:, None] * model.body_inertia[1:])
    torso = model.body(g1.TORSO_BODY).id
    other = np.delete(ratio, torso - 1)
    assert (np.abs(other - 1) <= 0.1 + 1e-9).all()
    assert 0 < np.abs(out.body_ipos[torso] - model.body_ipos[torso]).max() <= 0.05
    robot = model.body(g1.ROOT_BODY).id
    assert out.body_subtreemass[robot] == pytest.approx(out.body_mass[model.body_rootid == robot].sum())


def test_an_encoder_offset_shifts_where_the_joint_comes_to_rest(model):
    out = drawn(model, joint_offset_rad=0.05)
    offset = joint_offset(out)
    assert 0.02 < np.abs(offset).max() <= 0.05
    data = mujoco.MjData(out)
    data.qpos[:] = model.qpos0
    data.ctrl[:] = model.qpos0[7:27]
    mujoco.mj_forward(out, data)
    wanted = -out.actuator_gainprm[:, 0] * offset
    np.testing.assert_allclose(data.actuator_force, np.clip(wanted, *out.actuator_forcerange.T), atol=1e-9)


def test_robots_depend_neither_on_obstacles_nor_on_those_before_them(states):
    device = torch.device("cpu")
    (gap,) = load_scenes(["gap"])
    bare = CarryBank.of(states, 0.005, device, dynamics=STUDENT_DYNAMICS, seed=3)
    among = CarryBank.of(states, 0.005, device, dynamics=STUDENT_DYNAMICS, seed=3, scene=gap)
    for a, b in zip(bare.models, among.models, strict=True):
        assert b.ngeom > a.ngeom
        for name in ("actuator_gainprm", "actuator_biasprm", "dof_frictionloss", "dof_armature"):
            np.testing.assert_array_equal(getattr(a, name), getattr(b, name))
        masses = ([m.body(a.body(i).name).mass[0] for i in range(1, a.nbody)] for m in (a, b))
        assert next(masses) == next(masses)
        shared = [a.geom(i).name for i in range(a.ngeom) if a.geom(i).name]
        assert len(shared) > 5
        np.testing.assert_array_equal(
            [a.geom(n).friction[0] for n in shared],
            [b.geom(n).friction[0] for n in shared],
            "friction of robot and object",
        )


def test_a_bank_holds_another_robot_for_each_state(states):
    bank = CarryBank.of(states[:2], 0.005, "cpu", dynamics=STUDENT_DYNAMICS, seed=2)
    assert {"actuator_gainprm", "body_ipos", "geom_friction"} <= set(differing_fields(bank.models))
    assert bank.joint_offset.shape == (2, 20) and float(bank.joint_offset.abs().max()) > 0


@pytest.mark.parametrize("bad", [{"gain": -0.1}, {"mass": 1.0}, {"torso_com_m": float("nan")}])
def test_impossible_spreads_are_refused(bad):
    with pytest.raises(InvalidConfig, match=next(iter(bad))):
        DynamicsConfig(**bad)


def test_a_torso_without_mass_is_refused(model):
    kg = float(model.body_mass[model.body(g1.TORSO_BODY).id])
    drawn(model, torso_mass_kg=0.49 * kg, mass=0.5)
    with pytest.raises(InvalidConfig, match=r"torso_mass_kg is .* less than"):
        drawn(model, torso_mass_kg=0.51 * kg, mass=0.5)
