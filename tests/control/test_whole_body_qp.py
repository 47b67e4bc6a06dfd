"""The whole-body QP: dynamics, cones and limits of its solutions, its fallback, and one solver against the other."""

import copy
import subprocess
import sys
from dataclasses import replace

import mujoco
import numpy as np
import pytest

pytest.importorskip("pinocchio")
pytest.importorskip("proxsuite")

from hotice.control.pick_plan.grip import PALM_POINTS_M, PALM_RADIUS_M
from hotice.control.plant import TorquePlant
from hotice.control.whole_body.contacts import PALM_M, SOLE_POINTS_M, Contacts
from hotice.control.whole_body.qp import FEET, FIRST_CONE, HANDS, NV, QpConfig, WholeBodyQp
from hotice.control.whole_body.solvers import Guess, Problem, make_solver
from hotice.control.whole_body.tasks import Targets
from hotice.control.whole_body.terms import FRAMES, PELVIS, Terms, robot_model
from hotice.errors import HoticeError, InvalidConfig, UnknownName
from hotice.model import Box, builder, g1
from hotice.model.carry import solve_carry
from hotice.model.joint_limits import torque_limits

CARRY = solve_carry(Box((0.25, 0.25, 0.25), 2.0))


@pytest.fixture(scope="module")
def plant():
    plant = TorquePlant(builder.build_model(None, wrist_pos=CARRY.wrist_pos))
    plant.reset(CARRY.qpos()[:27])
    return plant


def standing(qp, measurement, *, load_kg=0.0, squeeze_n=0.0):
    """Tasks that keep the robot where it is, with the hands pressing on an object of some mass."""
    targets, contacts = Targets(), Contacts()
    qp.terms.update(measurement)
    targets.com_pos[:] = qp.terms.com
    targets.frame_pos[:], targets.frame_rot[:] = qp.terms.p_WF, qp.terms.R_WF
    targets.joint_pos[:] = measurement.joint_pos
    targets.gain_com([10.0, 10.0, 0.0], 5.0)
    targets.gain_frame("pelvis", [0.0, 0.0, 10.0, 5.0, 5.0, 5.0], 6.0)
    targets.gain_joints(np.where(np.arange(20) < 12, 0.1, 1.0), 10.0)
    contacts.hand_force_ref_W[:] = squeeze_n * contacts.hand_normal_W
    contacts.hand_force_max_n[:] = 3.0 * squeeze_n
    contacts.load_kg = load_kg
    return targets, contacts


def disturbed(measurement, seed, size=0.1):
    """The measurement with joints, velocities and pelvis off at random."""
    rng = np.random.default_rng(seed)
    quat = measurement.quat_WP + 0.3 * size * rng.normal(size=4)
    return replace(
        measurement,
        joint_pos=measurement.joint_pos + size * rng.normal(size=20),
        joint_vel=size * rng.normal(size=20),
        v_WP=size * rng.normal(size=3),
        w_WP_P=size * rng.normal(size=3),
        quat_WP=quat / np.linalg.norm(quat),
    )


def test_terms_agree_with_mujoco():
    """Mass matrix of the joints, torques at rest, frames and their velocities, from the same state."""
    wrist = [0.2, -0.1, 0.3, -0.2, -0.1, -0.3]
    plant, terms = TorquePlant(builder.build_model(None, wrist_pos=wrist)), Terms(wrist)
    plant.reset(CARRY.qpos()[:27])
    state = disturbed(plant.measure(), 0, 0.2)
    qpos = np.concatenate([state.p_WP, state.quat_WP, state.joint_pos])
    plant.reset(qpos, np.concatenate([state.v_WP, state.w_WP_P, state.joint_vel]))
    model, data = plant.model, plant.data
    terms.update(plant.measure())
    full = np.zeros((26, 26))
    mujoco.mj_fullM(model, data, full)
    upper = np.triu_indices(20)
    np.testing.assert_allclose(terms.M[6:, 6:][upper], full[6:, 6:][upper], atol=1e-9)
    names = ("pelvis", "left_ankle_roll_link", "right_ankle_roll_link")
    for i, name in enumerate(names):
        np.testing.assert_allclose(terms.p_WF[i], data.body(name).xpos, atol=1e-9)
        np.testing.assert_allclose(terms.R_WF[i], data.body(name).xmat.reshape(3, 3), atol=1e-9)
    for i, side in enumerate(g1.SIDES):
        np.testing.assert_allclose(terms.p_WF[3 + i], data.site(f"{side}_hand").xpos, atol=1e-9)
        velocity = np.zeros(6)
        site = model.site(f"{side}_hand").id
        mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_SITE, site, velocity, 0)
        np.testing.assert_allclose(terms.v_WF[3 + i], np.roll(velocity, 3), atol=1e-9)
    np.testing.assert_allclose(terms.com, data.subtree_com[1], atol=1e-9)
    plant.reset(qpos)
    terms.update(plant.measure())
    np.testing.assert_allclose(terms.h[6:], data.qfrc_bias[6:], atol=1e-9)


def test_frame_accelerations_are_derivatives_of_velocities(plant):
    """J a + drift against a central difference of the velocity along a course of acceleration a."""
    import pinocchio as pin

    terms, rng, dt = Terms(CARRY.wrist_pos), np.random.default_rng(3), 1e-5
    terms.update(disturbed(plant.measure(), 1, 0.3))
    q, v, a = terms.q.copy(), terms.v.copy(), rng.normal(size=26)
    found = np.einsum("frk,k->fr", terms.J_WF, a) + terms.drift_WF
    com = terms.J_com @ a + terms.com_drift
    speeds, com_speeds = [], []
    for s in (-dt, dt):
        terms.q[:] = pin.integrate(terms.model, q, s * v + 0.5 * s * s * a)
        terms.v[:] = v + s * a
        terms.refresh()
        speeds.append(terms.v_WF.copy())
        com_speeds.append(terms.v_com.copy())
    np.testing.assert_allclose(found, (speeds[1] - speeds[0]) / (2 * dt), atol=1e-5)
    np.testing.assert_allclose(com, (com_speeds[1] - com_speeds[0]) / (2 * dt), atol=1e-5)


def test_points_of_soles_and_palms_are_those_of_the_description():
    """The numbers in `contacts` and `grip` against g1.xml."""
    model = builder.build_model(None)
    for i, side in enumerate(g1.SIDES):
        for k in range(4):
            sole = model.geom(f"{side}_sole_{k}")
            np.testing.assert_allclose(SOLE_POINTS_M[i, k], sole.pos - [0, 0, sole.size[0]], atol=1e-9)
        palms = np.array([model.geom(f"{side}_palm_{k}").pos for k in range(4)]) - model.site(f"{side}_hand").pos
        np.testing.assert_allclose(palms, PALM_POINTS_M, atol=1e-9)
        assert model.geom(f"{side}_palm_0").size[0] == PALM_RADIUS_M == abs(PALM_M[i, 1])
    np.testing.assert_allclose(torque_limits(g1.ACTION_JOINTS)[[0, 1, 3, 4, 12]], [88, 139, 139, 50, 25])


@pytest.mark.parametrize("seed", range(6))
def test_solution_obeys_dynamics_cones_and_limits(plant, seed):
    """Newton-Euler of robot and load with the forces of the solution, friction pyramids, torque and joint limits."""
    import pinocchio as pin

    qp = WholeBodyQp(CARRY.wrist_pos)
    targets, contacts = standing(qp, plant.measure(), load_kg=2.5, squeeze_n=50.0)
    measurement = disturbed(plant.measure(), seed)
    memory = qp.start(measurement)
    torque = qp.solve(measurement, targets, contacts, memory)
    assert memory.faults == 0
    a, x, terms = memory.guess.x[:NV], memory.guess.x, qp.terms
    data = terms.model.createData()
    residual = pin.rnea(terms.model, data, terms.q, terms.v, a).copy()
    residual[6:] -= torque
    forces = x[FEET].reshape(2, 4, 3)
    for foot in range(2):
        for f, p in zip(forces[foot], SOLE_POINTS_M[foot], strict=True):
            r = terms.R_WF[1 + foot] @ p
            residual -= terms.J_WF[1 + foot].T @ np.concatenate([f, np.cross(r, f)])
            assert f[2] >= -1e-3 and np.abs(f[:2]).max() <= qp.config.foot_friction * f[2] + 1e-3
    hands, load = x[HANDS].reshape(2, 3), np.zeros(3)
    for hand in range(2):
        f, r = hands[hand], terms.R_WF[3 + hand] @ PALM_M[hand]
        residual -= terms.J_WF[3 + hand].T @ np.concatenate([f, np.cross(r, f)])
        n = contacts.hand_normal_W[hand]
        assert f @ n >= -1e-3 and np.abs((f - f @ n * n)[[0, 2]]).max() <= qp.config.hand_friction * (f @ n) + 1e-3
        J, w = terms.J_WF[3 + hand], terms.v_WF[3 + hand, 3:]
        acceleration = J @ a + terms.drift_WF[3 + hand]
        load += 0.5 * (acceleration[:3] + np.cross(acceleration[3:], r) + np.cross(w, np.cross(w, r)))
    np.testing.assert_allclose(residual, 0.0, atol=2e-3)
    np.testing.assert_allclose(2.5 * (load + [0, 0, 9.81]) + hands.sum(axis=0), 0.0, atol=1e-3)
    assert (np.abs(torque) <= 0.95 * torque_limits(g1.ACTION_JOINTS) + 1e-3).all()
    ahead = measurement.joint_pos + 0.1 * measurement.joint_vel + 0.005 * a[6:]
    assert (ahead >= terms.lower - 1e-4).all() and (ahead <= terms.upper + 1e-4).all()


def test_torque_limits_bind(plant):
    """A wish that no motor could follow is answered at the limit, not beyond."""
    qp = WholeBodyQp(CARRY.wrist_pos, QpConfig(torque_share=0.5))
    targets, contacts = standing(qp, plant.measure())
    targets.joint_acc[12:] = 1e3
    targets.joint_weight[12:] = 100.0
    torque = qp.solve(plant.measure(), targets, contacts, qp.start(plant.measure()))
    limit = 0.5 * torque_limits(g1.ACTION_JOINTS)
    assert (np.abs(torque) <= limit + 1e-3).all()
    assert (np.abs(torque) > limit - 1e-2).any()


def test_a_foot_in_the_air_carries_nothing(plant):
    qp = WholeBodyQp(CARRY.wrist_pos)
    targets, contacts = standing(qp, plant.measure())
    contacts.foot_force_max_n[0] = 0.0
    memory = qp.start(plant.measure())
    qp.solve(plant.measure(), targets, contacts, memory)
    forces = memory.guess.x[FEET].reshape(2, 4, 3)
    np.testing.assert_allclose(forces[0], 0.0, atol=1e-3)
    assert forces[1, :, 2].sum() > 200.0


def test_a_moment_on_the_hands_is_carried_by_the_arms(plant):
    """A known moment changes the torques by −Jᵀ of it where nothing else changes."""
    qp = WholeBodyQp(CARRY.wrist_pos)
    targets, contacts = standing(qp, plant.measure())
    targets.gain_joints(1e3, 10.0)
    before = qp.solve(plant.measure(), targets, contacts, qp.start(plant.measure())).copy()
    contacts.hand_moment_W[:] = [[0.0, 2.0, 0.0], [0.0, 2.0, 0.0]]
    after = qp.solve(plant.measure(), targets, contacts, qp.start(plant.measure()))
    change = -sum(qp.terms.J_WF[3 + h, 3:].T @ contacts.hand_moment_W[h] for h in range(2))
    np.testing.assert_allclose((after - before)[12:], change[6:][12:], atol=0.05)


@pytest.mark.parametrize("seed", range(3))
def test_solvers_agree(plant, seed):
    """Same accelerations, hand forces and cost; how the feet share their force is almost free, torques differ a little
    by it."""
    found = {}
    for name in ("proxqp", "osqp"):
        qp = WholeBodyQp(CARRY.wrist_pos, QpConfig(solver=name))
        targets, contacts = standing(qp, plant.measure(), load_kg=1.5, squeeze_n=45.0)
        measurement = disturbed(plant.measure(), seed, 0.05)
        memory = qp.start(measurement)
        torque = qp.solve(measurement, targets, contacts, memory).copy()
        x, p = memory.guess.x, qp.problem
        assert memory.faults == 0
        found[name] = x, torque, 0.5 * x @ p.H @ x + p.g @ x
    (x, torque, cost), (y, other, other_cost) = found["proxqp"], found["osqp"]
    np.testing.assert_allclose(x[:NV], y[:NV], atol=0.05)  # 1 % of the largest
    np.testing.assert_allclose(x[HANDS], y[HANDS], atol=0.1)
    np.testing.assert_allclose(torque[12:], other[12:], atol=0.3)
    assert cost == pytest.approx(other_cost, rel=1e-5)


@pytest.mark.parametrize("name", ["proxqp", "osqp"])
def test_solvers_solve_a_problem_known_by_hand(name):
    """min ½|x|² − x₁ with x₁ + x₂ = 1 and x₂ ≥ 0.25: x = (0.75, 0.25)."""
    problem = Problem(n=2, equalities=1, inequalities=1)
    solver = make_solver(name, problem)
    problem.H[:], problem.g[:] = np.eye(2), [-1.0, 0.0]
    problem.A[:], problem.b[:] = [[1.0, 1.0]], [1.0]
    problem.C[:], problem.lower[:] = [[0.0, 1.0]], [0.25]
    guess = Guess.zeros(problem)
    assert solver.solve(guess)
    np.testing.assert_allclose(guess.x, [0.75, 0.25], atol=1e-3)


@pytest.mark.parametrize("name", ["proxqp", "osqp"])
def test_an_infeasible_problem_falls_back_and_is_counted(plant, name):
    """A hand that must pull on what it can only push has no solution: the last torque is repeated."""
    qp = WholeBodyQp(CARRY.wrist_pos, QpConfig(solver=name))
    targets, contacts = standing(qp, plant.measure(), load_kg=2.0, squeeze_n=45.0)
    memory = qp.start(plant.measure())
    good = qp.solve(plant.measure(), targets, contacts, memory).copy()
    contacts.hand_force_max_n[:] = -20.0
    for count in (1, 2):
        np.testing.assert_array_equal(qp.solve(plant.measure(), targets, contacts, memory), good)
        assert (memory.faults, memory.in_a_row) == (count, count)
    contacts.hand_force_max_n[:] = 135.0
    np.testing.assert_allclose(qp.solve(plant.measure(), targets, contacts, memory)[12:], good[12:], atol=0.3)
    assert (memory.faults, memory.in_a_row) == (2, 0)


@pytest.mark.parametrize("name", ["joint_pos", "joint_vel", "p_WP", "quat_WP", "v_WP", "w_WP_P"])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_measurements_that_are_not_finite_fall_back(plant, name, value):
    qp = WholeBodyQp(CARRY.wrist_pos)
    targets, contacts = standing(qp, plant.measure())
    memory = qp.start(plant.measure())
    good = qp.solve(plant.measure(), targets, contacts, memory).copy()
    broken = getattr(plant.measure(), name).copy()
    broken[1] = value
    for _ in range(15):  # beyond those that only repeat the torque
        torque = qp.solve(replace(plant.measure(), **{name: broken}), targets, contacts, memory)
        assert np.isfinite(torque).all() and (np.abs(torque) <= torque_limits(g1.ACTION_JOINTS)).all()
    assert memory.faults == 15
    np.testing.assert_allclose(qp.solve(plant.measure(), targets, contacts, memory), good, atol=0.2)


def test_long_faults_hold_the_last_angles(plant):
    """After `hold_faults` in a row servos pull back to the last safe joint angles."""
    qp = WholeBodyQp(CARRY.wrist_pos, QpConfig(hold_faults=2))
    targets, contacts = standing(qp, plant.measure())
    memory = qp.start(plant.measure())
    good = qp.solve(plant.measure(), targets, contacts, memory).copy()
    away = plant.measure().joint_pos.copy()
    away[15] += 0.1
    blind = replace(plant.measure(), joint_pos=away, v_WP=np.full(3, np.nan))
    for _ in range(3):
        torque = qp.solve(blind, targets, contacts, memory)
    np.testing.assert_allclose((torque - good)[15], -0.1 * g1.gains()[0][15], atol=1e-9)


def test_a_late_solve_is_a_fault(plant):
    qp = WholeBodyQp(CARRY.wrist_pos, QpConfig(deadline_s=1e-9))
    targets, contacts = standing(qp, plant.measure())
    memory = qp.start(plant.measure())
    torque = qp.solve(plant.measure(), targets, contacts, memory)
    assert (memory.faults, memory.late) == (1, 1) and (torque == 0).all()


def test_a_copied_memory_repeats_the_solve(plant):
    """All that lasts is in the memory: a copy gives the same torque again, bit for bit, whatever was solved in
    between."""
    qp = WholeBodyQp(CARRY.wrist_pos)
    targets, contacts = standing(qp, plant.measure())
    memory = qp.start(plant.measure())
    for seed in range(3):
        qp.solve(disturbed(plant.measure(), seed, 0.02), targets, contacts, memory)
    kept = copy.deepcopy(memory)
    first = qp.solve(disturbed(plant.measure(), 9, 0.02), targets, contacts, memory).copy()
    qp.solve(disturbed(plant.measure(), 5, 0.1), targets, contacts, memory)
    again = qp.solve(disturbed(plant.measure(), 9, 0.02), targets, contacts, kept)
    np.testing.assert_allclose(again, first, atol=1e-9)


@pytest.mark.slow
def test_the_robot_stands_and_squats(plant):
    """Four seconds of swaying and squatting: upright, feet where they were, no fault."""
    plant.reset(CARRY.qpos()[:27])
    qp = WholeBodyQp(CARRY.wrist_pos)
    measurement = plant.measure()
    targets, contacts = standing(qp, measurement)
    memory, feet = qp.start(measurement), qp.terms.p_WF[1:3].copy()
    for _ in range(800):
        t = plant.data.time
        targets.com_pos[1] = 0.04 * np.sin(2 * t)
        targets.frame_pos[PELVIS, 2] = CARRY.root_pos_W[2] - 0.08 * (1 - np.cos(1.5 * t))
        plant.step(qp.solve(plant.measure(), targets, contacts, memory))
    assert memory.faults == 0
    assert abs(plant.measure().p_WP[2] - targets.frame_pos[PELVIS, 2]) < 0.02
    np.testing.assert_allclose(qp.terms.p_WF[1:3], feet, atol=0.01)


def test_bad_parameters_say_so():
    with pytest.raises(UnknownName, match="known are osqp, proxqp"):
        WholeBodyQp(config=QpConfig(solver="simplex"))
    with pytest.raises(InvalidConfig, match="above 0"):
        QpConfig(foot_friction=-1.0)
    with pytest.raises(InvalidConfig, match="at most 1"):
        QpConfig(torque_share=1.5)
    with pytest.raises(InvalidConfig, match="g1.WRIST_JOINTS.*6 finite numbers"):
        robot_model([0.0, np.nan, 0, 0, 0, 0])
    with pytest.raises(UnknownName, match="left_hand"):
        Targets().gain_frame("nose", 1.0, 1.0)
    assert issubclass(InvalidConfig, HoticeError) and len(FRAMES) == 5
    assert FIRST_CONE == 40


KEPT = """
import ctypes
from hotice.control.whole_body.solvers import Guess, Problem, make_solver

problem = Problem(n=2, equalities=0, inequalities=0)
problem.H[:], problem.g[:] = [[1.0, 0.0], [0.0, 1.0]], 1.0
solver, guess = make_solver("proxqp", problem), Guess.zeros(problem)
print(solver.solve(guess))
ctypes.pythonapi.Py_IncRef(ctypes.py_object(solver))  # kept for ever, as a diagram keeps its systems
"""


def test_a_solver_that_outlives_the_program_is_no_leak():
    done = subprocess.run([sys.executable, "-c", KEPT], capture_output=True, text=True, timeout=120)
    assert (done.returncode, done.stdout, done.stderr) == (0, "True\n", "")
