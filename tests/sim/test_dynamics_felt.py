"""Drawn robots as the simulator feels them: forces, weights and inertias it computes, not the fields that were
written."""

import copy
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest
import torch

from hotice.errors import InvalidConfig
from hotice.model import Box, builder, g1
from hotice.model.carry import Posture, solve_carry
from hotice.model.dynamics import ROBOT_DYNAMICS, DynamicsConfig, joint_offset, perturb
from hotice.sim.carry_bank import CarryBank
from hotice.sim.physics.mujoco_batch import MujocoBatch, differing_fields

ROBOTS, FEW = 200, 8
G = 9.81
MOTORS, OBJECT = slice(6, 26), slice(26, 32)
STEP_RAD, SPIN_RAD_S = 0.02, 0.05
ALONE = {
    "mass": DynamicsConfig(mass=0.1),
    "torso": DynamicsConfig(torso_mass_kg=1.0, torso_com_m=0.1),
    "armature": DynamicsConfig(armature=0.05),
    "all": ROBOT_DYNAMICS,
}
"""Populations in which something can be weighed apart from the rest."""


@pytest.fixture(scope="module")
def state():
    return solve_carry(Box((0.3, 0.3, 0.3), 1.5), Posture())


@pytest.fixture(scope="module")
def model(state):
    return builder.build_model(state.carried, wrist_pos=state.wrist_pos)


@pytest.fixture(scope="module")
def robots(model):
    return {
        name: [perturb(model, config, np.random.default_rng([7, i])) for i in range(ROBOTS)]
        for name, config in ALONE.items()
    }


def plain(models):
    """`forward(qpos, qvel, ctrl)` of each model in turn; what it computes, (N, ...)."""

    def forward(*state):
        rows = []
        for m in models:
            data = mujoco.MjData(m)
            data.qpos[:], data.qvel[:], data.ctrl[:] = state
            mujoco.mj_forward(m, data)
            rows.append([getattr(data, name).copy() for name in READ])
        return seen(models[0], [np.stack(values) for values in zip(*rows, strict=True)])

    return forward


def batch(models):
    """The same of rows of a `MujocoBatch`, whose models were dealt out anew."""
    n = len(models)
    physics = MujocoBatch(models[::-1], n, threads=1)
    physics.set_models(torch.arange(n), torch.arange(n).flip(0))

    def forward(*state):
        physics.qpos[:], physics.qvel[:], physics.ctrl[:] = (torch.tensor(s) for s in state)
        physics._warmstart.zero_()
        physics.batch.forward(stage=mujoco.mjtStage.mjSTAGE_ACC)
        return seen(models[0], [physics.batch.bind(name).reshape(n, -1).copy() for name in READ])

    return forward


def warp(models):
    """The same of worlds of MuJoCo Warp."""
    import mujoco_warp as mjw

    from hotice.sim.physics.mujoco_warp import MujocoWarp

    n = len(models)
    physics = MujocoWarp(models[::-1], n, "cpu")
    physics.set_models(torch.arange(n), torch.arange(n).flip(0))

    def forward(*state):
        for target, value in zip((physics.qpos, physics.qvel, physics.ctrl), state, strict=True):
            target[:] = torch.tensor(value, dtype=torch.float32)
        physics._warmstart.zero_()
        mjw.forward(physics._m, physics._d)
        return seen(models[0], [getattr(physics._d, name).numpy().copy() for name in READ])

    return forward


READ = ("M", "qfrc_bias", "qfrc_constraint", "qfrc_actuator", "cinert", "qacc")


def seen(model, values):
    """By name; of the inertia matrix the diagonal, of `cinert` the masses."""
    found = SimpleNamespace(**dict(zip(READ, values, strict=True)))
    n, nv = len(found.M), model.nv
    if found.M.ndim == 3:  # dense in MuJoCo Warp
        found.M = np.diagonal(found.M, axis1=1, axis2=2)[:, :nv]
    else:
        found.M = found.M[:, model.M_rowadr + model.M_rownnz - 1]
    found.cinert = found.cinert.reshape(n, model.nbody, 10)[:, :, 9]
    return found


def hanging(state, tilted=False):
    """Robot in the air, on its face if `tilted`, the object far above: nothing touches."""
    qpos = np.array(state.qpos())
    qpos[2], qpos[29] = 3.0, 9.0
    if tilted:
        qpos[3:7] = np.cos(np.pi / 4), 0.0, np.sin(np.pi / 4), 0.0
    return qpos


def felt(forward, state):
    """Of each robot, by parameter: what can be read off what the simulator computes."""
    q, rest, target = hanging(state), np.zeros(32), state.joint_pos
    spin = np.zeros(32)
    spin[MOTORS] = SPIN_RAD_S
    still, flat = (forward(pose, rest, target) for pose in (q, hanging(state, tilted=True)))
    pulled, spun = forward(q, rest, target + STEP_RAD), forward(q, spin, target)
    most, least = (forward(q, rest, target + far).qfrc_actuator[:, MOTORS] for far in (100.0, -100.0))
    # servos brake hard
    ahead, back = (forward(q, s * 60.0 * spin, target).qfrc_constraint[:, MOTORS] for s in (1.0, -1.0))
    force = still.qfrc_actuator[:, MOTORS]
    kp = (pulled.qfrc_actuator[:, MOTORS] - force) / STEP_RAD
    return SimpleNamespace(
        kp=kp,
        offset=-force / kp,
        kd=(force - spun.qfrc_actuator[:, MOTORS]) / SPIN_RAD_S,
        most=most,
        least=least,
        friction=-ahead,
        friction_back=back,
        inertia=still.M,
        links=still.cinert,
        mass=still.qfrc_bias[:, 2] / G,
        load=still.qfrc_bias[:, 28] / G,
        moment=np.stack([-still.qfrc_bias[:, 4], still.qfrc_bias[:, 3], -flat.qfrc_bias[:, 4]], axis=1) / G,
    )


def assert_uniform(values, low, high):
    """Mean, spread and range of a uniform draw, to four standard errors."""
    values = np.ravel(values)
    n, span = len(values), high - low
    assert low - 1e-9 <= values.min() < low + 0.05 * span and high + 1e-9 >= values.max() > high - 0.05 * span
    assert values.mean() == pytest.approx((low + high) / 2, abs=4 * span / np.sqrt(12 * n))
    assert values.std() == pytest.approx(span / np.sqrt(12), rel=4 / np.sqrt(2.5 * n))


def assert_apart(values):
    """Columns are drawn one by one: no pair of neighbours goes together."""
    r = np.corrcoef(values.T)[np.arange(values.shape[1] - 1), np.arange(1, values.shape[1])]
    assert np.abs(r).max() < 5 / np.sqrt(len(values))


@pytest.fixture(scope="module")
def found(robots, model, state):
    return {name: felt(plain(models), state) for name, models in {**robots, "nominal": [model]}.items()}


def test_motors_feel_their_gains_strength_and_offset(found, robots):
    a, n, c = found["all"], found["nominal"], ROBOT_DYNAMICS
    strength = a.most / n.most
    np.testing.assert_allclose(a.least, -a.most, rtol=1e-12)
    assert_uniform(strength, 1 - c.motor_strength, 1 + c.motor_strength)
    kp, kd = a.kp / n.kp / strength, a.kd / n.kd / strength
    for share in (kp, kd):
        assert_uniform(share, 1 - c.gain, 1 + c.gain)
    assert_apart(np.stack([strength[:, 0], kp[:, 0], kd[:, 0]], axis=1))
    assert_apart(kp)
    assert_uniform(a.offset, -c.joint_offset_rad, c.joint_offset_rad)
    read = np.stack([joint_offset(m) for m in robots["all"]])
    np.testing.assert_allclose(a.offset, read, atol=1e-12, err_msg="encoders err as servos do")


def test_joints_feel_their_friction_and_armature(found, model):
    a, n = found["all"], found["nominal"]
    assert not n.friction.any()
    np.testing.assert_allclose(a.friction, a.friction_back, atol=1e-9, err_msg="against the motion, both ways")
    assert_uniform(a.friction, 0.0, ROBOT_DYNAMICS.friction_loss_nm)
    assert_apart(a.friction)
    more = found["armature"].inertia - n.inertia
    assert np.abs(more[:, :6]).max() < 1e-9 and np.abs(more[:, OBJECT]).max() < 1e-12
    assert_uniform(more[:, MOTORS] / model.dof_armature[MOTORS], 0.0, ROBOT_DYNAMICS.armature)


@pytest.mark.parametrize("step_s, least", [(0.010, 0.85), (0.005, 0.95), (0.002, 0.99)])
def test_dry_friction_takes_the_energy_it_is_written_to_take(state, step_s, least):
    """Of a robot with random targets, over all physics steps in which a joint keeps its direction."""
    model = builder.build_model(state.carried, wrist_pos=state.wrist_pos, timestep_s=step_s)
    robot, rng = perturb(model, ROBOT_DYNAMICS, np.random.default_rng(0)), np.random.default_rng(0)
    data, taken, written = mujoco.MjData(robot), 0.0, 0.0
    data.qpos[:] = state.qpos()
    for _ in range(20):
        data.ctrl[:] = state.joint_target + 0.1 * rng.standard_normal(20)
        for _ in range(round(0.02 / step_s)):
            before = data.qvel[MOTORS].copy()
            mujoco.mj_step(robot, data)
            dry = data.efc_type == mujoco.mjtConstraint.mjCNSTR_FRICTION_DOF
            force = np.zeros(robot.nv)
            force[data.efc_id[dry]] = data.efc_force[dry]
            moves = (np.abs(before) > 0.1) & (before * data.qvel[MOTORS] > 0)
            taken -= (force[MOTORS] * before)[moves].sum()
            written += (robot.dof_frictionloss[MOTORS] * np.abs(before))[moves].sum()
    assert least < taken / written <= 1.0


def test_links_weigh_what_was_drawn(found, model):
    a, n = found["mass"], found["nominal"]
    link = np.flatnonzero(model.body_rootid == model.body(g1.ROOT_BODY).id)
    share = a.links[:, link] / n.links[:, link]
    assert_uniform(share, 1 - ROBOT_DYNAMICS.mass, 1 + ROBOT_DYNAMICS.mass)
    assert_apart(share)
    for weighed in (a.mass, a.inertia[:, 0], a.inertia[:, 2]):
        np.testing.assert_allclose(weighed, a.links[:, link].sum(axis=1), rtol=1e-9)
    assert (a.load == n.load).all()


def test_the_torso_hangs_where_and_as_heavy_as_drawn(found, model, state):
    """From the robot's weight and its moments about the pelvis, in two attitudes."""
    a, n = found["torso"], found["nominal"]
    data = mujoco.MjData(model)
    data.qpos[:] = hanging(state)
    mujoco.mj_kinematics(model, data)
    torso, pelvis = data.body(g1.TORSO_BODY), data.body(g1.ROOT_BODY)
    np.testing.assert_allclose(
        torso.xmat.reshape(3, 3), np.eye(3), atol=1e-12, err_msg="the torso's axes are the pelvis'"
    )
    kg = float(model.body(g1.TORSO_BODY).mass[0])
    more = a.mass - n.mass
    assert_uniform(more, -ROBOT_DYNAMICS.torso_mass_kg, ROBOT_DYNAMICS.torso_mass_kg)
    arm = (a.moment - n.moment + kg * (torso.xipos - pelvis.xpos)) / (kg + more)[:, None]
    shift = arm - (torso.xipos - pelvis.xpos)
    for axis in range(3):
        assert_uniform(shift[:, axis], -ROBOT_DYNAMICS.torso_com_m, ROBOT_DYNAMICS.torso_com_m)
    assert_apart(shift)


def test_the_load_is_as_heavy_and_as_inert_as_drawn(found, state):
    a, kg = found["all"], state.carried.mass_kg
    assert_uniform(a.load / kg, 1 - ROBOT_DYNAMICS.payload, 1 + ROBOT_DYNAMICS.payload)
    inertia = np.r_[np.full(3, kg), state.carried.inertia_diag_kgm2]
    np.testing.assert_allclose(a.inertia[:, OBJECT], (a.load / kg)[:, None] * inertia, rtol=1e-9)


def test_no_geometry_moves_with_the_centre_of_mass(robots, model, state):
    """Geoms and sites may be kept relative to it."""
    a, b = mujoco.MjData(model), mujoco.MjData(robots["torso"][0])
    for m, data in ((model, a), (robots["torso"][0], b)):
        data.qpos[:] = state.qpos()
        mujoco.mj_forward(m, data)
    for name in ("geom_xpos", "geom_xmat", "site_xpos"):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name))
    np.testing.assert_array_equal(a.contact.pos, b.contact.pos)
    assert a.ncon > 8


def test_rows_of_a_batch_feel_the_same(robots, found, state):
    for name, models in robots.items():
        for what, values in vars(felt(batch(models), state)).items():
            np.testing.assert_array_equal(values, getattr(found[name], what), err_msg=f"{name}: {what}")


@pytest.mark.parametrize("elliptic", [False, True])
def test_a_perturbed_robot_in_a_batch_moves_as_alone(state, elliptic):
    """Every field in which robots differ acts, also what MuJoCo derives from masses: bit for bit a loop of
    `mj_step`."""
    bank = CarryBank.of([state] * 4, 0.005, torch.device("cpu"), dynamics=ROBOT_DYNAMICS, elliptic=elliptic)
    physics, order = MujocoBatch(bank.models, 4, threads=1), [2, 0, 3, 1]
    physics.set_models(torch.arange(4), torch.tensor(order))
    plain = [(bank.models[i], mujoco.MjData(bank.models[i])) for i in order]
    physics.qpos[:] = bank.qpos
    for _, data in plain:
        data.qpos[:] = state.qpos()
    rng = np.random.default_rng(0)
    for _ in range(10):
        ctrl = state.joint_target + 0.1 * rng.standard_normal(20)
        physics.ctrl[:] = torch.tensor(ctrl)
        physics.step(4)
        for row, (m, data) in enumerate(plain):
            data.ctrl[:] = ctrl
            mujoco.mj_step(m, data, 4)
            np.testing.assert_array_equal(physics.qpos[row].numpy(), data.qpos)
    assert len(torch.unique(physics.qpos[:, 10])) == 4


SILENT = {"actuator_acc0", "body_subtreemass", "bvh_aabb"}
"""Differences that act on no force here: of muscles, of centres of mass that only tell, of which pairs are looked at
closely."""


MASSES = ("body_mass", "body_inertia", "dof_M0")
"""MuJoCo takes the inertia of a free body, the load, from the last, MuJoCo Warp from the others."""


def one_by_one(robots):
    """A robot, and by name robots that take one differing field each from another; masses with what is made of them."""
    first, other, *_ = robots["all"]
    mixed = {name: copy.copy(first) for name in differing_fields([first, other]) if name not in MASSES[1:]}
    for name, robot in mixed.items():
        for field in MASSES if name == MASSES[0] else [name]:
            getattr(robot, field)[:] = getattr(other, field)
    return first, mixed


def accelerations(forward, state):
    """Of a robot that stands on the floor and holds the object: at rest, as it moves, and with all that its servos
    have."""
    qpos, qvel = np.array(state.qpos()), np.zeros(32)
    qpos[[2, -5]] -= 0.001
    qvel[MOTORS] = np.linspace(-1.0, 1.0, 20)
    cases = ((0.0, 0.0), (1.0, 0.0), (1.0, 100.0))
    return np.concatenate([forward(qpos, v * qvel, state.joint_target + far).qacc for v, far in cases], axis=1)


def test_each_field_that_differs_acts(robots, state):
    first, mixed = one_by_one(robots)
    exact = accelerations(plain([first, *mixed.values()]), state)
    np.testing.assert_array_equal(accelerations(batch([first, *mixed.values()]), state), exact)
    change = np.abs(exact[1:] - exact[0]).max(axis=1)
    assert {name for name, most in zip(mixed, change, strict=True) if most < 1e-6} == SILENT


@pytest.mark.slow
@pytest.mark.parity
def test_worlds_of_warp_feel_the_same(robots, found, state):
    pytest.importorskip("mujoco_warp")
    for what, values in vars(felt(warp(robots["all"][:FEW]), state)).items():
        exact = getattr(found["all"], what)[:FEW]
        np.testing.assert_allclose(values, exact, rtol=2e-4, atol=1e-4 * np.abs(exact).max(), err_msg=what)
    from hotice.sim.physics.mujoco_warp import _NOT_SIMULATED

    first, mixed = one_by_one(robots)
    exact = accelerations(plain([first, *mixed.values()]), state)
    ours = accelerations(warp([first, *mixed.values()]), state)
    for name, a, b in zip(mixed, ours[1:] - ours[0], exact[1:] - exact[0], strict=True):
        if name not in SILENT | _NOT_SIMULATED:
            np.testing.assert_allclose(a, b, rtol=0, atol=0.03 * np.abs(b).max(), err_msg=name)


def test_models_of_other_settings_share_no_batch(model):
    """They are read off the first model: those of others would not act."""
    other = copy.copy(model)
    other.opt.timestep = 0.002
    with pytest.raises(InvalidConfig, match="opt.timestep"):
        MujocoBatch([model, other], 2, threads=1)
