"""Courses of picks for robots whose mass is elsewhere: balanced, feet and hands where the plan has them."""

from pathlib import Path

import mujoco
import numpy as np
import pytest
import torch

from hotice.model import builder, g1
from hotice.model.dynamics import DynamicsConfig
from hotice.model.picks.book import BOOK_PHASES, PickBook
from hotice.sim.pickup import bank
from hotice.sim.pickup.env import PickUpEnv
from hotice.sim.pickup.standing import CLEAR_M, Standing, Wishes
from hotice.sim.pickup.truth import Course, true_course
from hotice.task.config import TaskConfig
from hotice.task.pickup import pickup_task

BOOK = Path(__file__).parent / "data" / "picks.npz"
LIFT = BOOK_PHASES.index("lift")


@pytest.fixture(scope="module")
def book():
    return PickBook.load(BOOK)


def model_of(book, row, com=(0.0, 0.0, 0.0), kg=0.0, nearer_m=0.0):
    top, near = book.support[row]
    scene = bank.table(top, near - nearer_m)
    model = builder.build_model(book.carried(row), scene, wrist_pos=book.wrist[row], timestep_s=0.002, elliptic=True)
    torso = model.body("torso_link").id
    model.body_ipos[torso] += com
    model.body_mass[torso] += kg
    mujoco.mj_setConst(model, mujoco.MjData(model))
    return model


def gap(robot):
    """Between legs and support, at most `CLEAR_M` [m]."""
    return min((near[0] for near in robot.near_support()), default=CLEAR_M)


def test_the_described_robot_follows_the_plan(book):
    for row in range(len(book)):
        model = model_of(book, row)
        robot = Standing(model, book, row)
        gaps = []
        for q in np.asarray(book.joint_pos[row], float)[::10]:
            robot.stand(q)
            gaps.append(gap(robot))
        if min(gaps) < CLEAR_M:
            continue
        course = true_course(book, row, model, model)
        np.testing.assert_allclose(course.joint_pos, book.joint_pos[row], atol=1e-6)
        np.testing.assert_allclose(course.joint_pos + course.torque / g1.gains()[0], book.target[row], atol=1e-5)
        return
    pytest.fail("no pick of the book is clear of its support")


@pytest.mark.parametrize("com", [(0.08, -0.06, 0.1), (-0.07, 0.09, -0.1)])
def test_mass_that_is_elsewhere_is_put_over_the_feet_again(book, com):
    plan, model = model_of(book, 0), model_of(book, 0, com, kg=0.8)
    course = true_course(book, 0, plan, model)
    kg, meant, there, moved = float(book.mass[0]), Standing(plan, book, 0), Standing(model, book, 0), []
    for k in (110, 200, 300, len(book.phase) - 1):
        load = kg * (book.phase[k] >= LIFT)
        meant.stand(np.asarray(book.joint_pos[0][k], float))
        there.stand(course.joint_pos[k])
        np.testing.assert_allclose(there.com(load)[:2], meant.com(load)[:2], atol=2e-3)
        for a, b in zip(meant.feet, there.feet, strict=True):
            np.testing.assert_allclose(there.data.xpos[b], meant.data.xpos[a], atol=1e-3)
        hands = there.data.site_xpos[there.hands] - meant.data.site_xpos[meant.hands]
        assert np.linalg.norm(hands, axis=1).max() < 0.01
        moved.append(np.linalg.norm(course.pelvis[k] - book.pelvis[0][k, :2]))
        # without: what the feet would have to bear
        there.stand(np.asarray(book.joint_pos[0][k], float))
        assert np.linalg.norm((there.com(load) - meant.com(load))[:2]) > 0.02
    assert max(moved) > 0.01
    # at the start the robot stands as it was put
    np.testing.assert_allclose(course.joint_pos[0], book.joint_pos[0][0], atol=2e-3)


def test_static_forces_leave_nothing_at_the_pelvis(book):
    model = model_of(book, 1, (0.05, 0.03, 0.0), kg=-0.5)
    robot = Standing(model, book, 1)
    for k in (0, 150, 400):
        robot.stand(np.asarray(book.joint_pos[1][k], float))
        missing = robot.static(2.0)[:6]
        assert np.abs(missing[:3]).max() < 1e-6 and np.abs(missing[3:]).max() < 0.05


def test_legs_keep_off_a_support_that_is_nearer_than_planned(book):
    model = model_of(book, 0, nearer_m=0.05)
    course, robot = true_course(book, 0, model, model), Standing(model, book, 0)

    def least(path):
        found = []
        for q in np.asarray(path, float)[100::20]:
            robot.stand(q)
            found.append(gap(robot))
        return min(found)

    assert least(book.joint_pos[0]) < 0.04
    assert least(course.joint_pos) > least(book.joint_pos[0]) + 0.01


def test_a_step_stays_within_bounds_and_is_the_best_there():
    rng = np.random.default_rng(3)
    A, b = rng.normal(size=(40, 26)), rng.normal(size=40)
    wishes = Wishes()
    wishes.add(2.0, A, b)
    free = wishes.step(np.full(20, -9.0), np.full(20, 9.0))
    np.testing.assert_allclose(free, np.linalg.lstsq(A, b, rcond=None)[0], atol=1e-9)
    low, high = np.full(20, -9.0), np.full(20, 9.0)
    high[4] = free[10] - 0.1
    step = wishes.step(low, high)
    assert step[10] == high[4]
    held = np.delete(np.arange(26), 10)
    rest = np.linalg.lstsq(A[:, held], b - A[:, 10] * step[10], rcond=None)[0]
    np.testing.assert_allclose(step[held], rest, atol=1e-9)


@pytest.mark.slow
def test_the_teacher_keeps_robots_up_whose_torso_is_elsewhere(book, monkeypatch):
    """For 4 s: the pelvis stays within 3 cm of its course; by the plan alone one of these four falls."""

    def farthest():
        task = pickup_task(TaskConfig(dynamics=DynamicsConfig(torso_com_m=0.1, torso_mass_kg=1.0)))
        env = PickUpEnv(len(book), book, seed=1, config=task, threads=1)
        env.restarts, env.in_turn = False, True
        env.reset()
        off = torch.zeros(len(book))
        for _ in range(200):
            s = env.snapshot()
            off = torch.maximum(off, s.offset.norm(dim=1))
            if env.step(env.label(s)).outcome.any():
                return 1.0
        return float(off.max())

    assert farthest() < 0.03

    def plan(book, row, described, true):
        joints = np.asarray(book.joint_pos[row], float)
        torque = (np.asarray(book.target[row], float) - joints) * g1.gains()[0]
        return Course(joint_pos=joints, torque=torque, pelvis=np.asarray(book.pelvis[row], float)[:, :2])

    monkeypatch.setattr(bank, "true_course", plan)
    assert farthest() == 1.0
