"""Picks as position targets: they are the plan's, they hold it at rest, and played back they pick the object up."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

pytest.importorskip("pinocchio")
pytest.importorskip("pydrake")
pytest.importorskip("adam.casadi")

from hotice.control.pick_plan import Planner, Support
from hotice.control.playback import PLAYED, Player, plan_book, static_torque
from hotice.control.playback.course import Pick
from hotice.control.playback.draw import PickRange, draw_books
from hotice.errors import InvalidState, PickInfeasible
from hotice.model import Box, BoxShape, Obstacle, Scene, builder, g1
from hotice.model.frames import quat_from_yaw
from hotice.model.picks.book import BOOK_PHASES, PickBook, balance, balance_gains

PICK = Pick(
    carried=Box((0.26, 0.28, 0.28), 1.5), support=Support(top_m=0.5, near_m=0.24), x_m=0.39, y_m=0.02, yaw_rad=0.1
)


@pytest.fixture(scope="module")
def planned(tmp_path_factory):
    planner = Planner(PICK.carried, PICK.support, PLAYED.durations, calm=True)
    return planner, planner.plan(planner.start_q, PICK.p_GO, quat_from_yaw(PICK.yaw_rad))


@pytest.fixture(scope="module")
def book():
    return plan_book(PICK)


def test_the_book_goes_through_the_plan(planned, book):
    _, plan = planned
    phase = list(book.phase)
    for name, knot in (("crouch", plan.crouch), ("reach", plan.pregrasp), ("close", plan.grasp), ("retreat", None)):
        last = len(phase) - 1 - phase[::-1].index(BOOK_PHASES.index(name))
        wanted = plan.retreat[-1] if knot is None else knot
        np.testing.assert_allclose(book.joint_pos[0, last], wanted[g1.JOINT_POS], atol=1e-6)
        np.testing.assert_allclose(book.pelvis[0, last], wanted[:3], atol=1e-6)
    seconds = [PLAYED.settle_s, PLAYED.crouch_s, PLAYED.reach_s, PLAYED.close_s, PLAYED.squeeze_s, PLAYED.lift_s]
    assert [phase.count(k) for k in range(7)] == [round(s / 0.02) for s in (*seconds, PLAYED.retreat_s)]


def test_targets_are_angles_and_static_torques_by_the_servo_law(planned, book):
    planner, plan = planned
    kp, _ = g1.gains()
    # standing before the first move: nothing is pressed, nothing carried
    torque, _ = static_torque(planner.terms, planner.start_q, 0.0, 0.0, plan.p_HO, plan.hand_point)
    np.testing.assert_allclose(book.target[0, 0], planner.start_q[g1.JOINT_POS] + torque / kp, atol=1e-5)
    torque, _ = static_torque(planner.terms, plan.retreat[-1], float(book.squeeze[0]), 1.5, plan.p_HO, plan.hand_point)
    np.testing.assert_allclose(book.target[0, -1], plan.retreat[-1][g1.JOINT_POS] + torque / kp, atol=1e-5)
    assert book.squeeze[0] == pytest.approx(45.0 + 15.0 * 1.5 / 3.5)


def test_floor_and_hands_carry_all_weight(planned):
    """Nothing is missing at the pelvis, whatever the configuration, grip and load."""
    planner, plan = planned
    for q, press, load in ((planner.start_q, 0.0, 0.0), (plan.grasp, 50.0, 0.0), (plan.retreat[5], 60.0, 3.0)):
        _, missing = static_torque(planner.terms, q, press, load, plan.p_HO, plan.hand_point)
        np.testing.assert_allclose(missing, 0.0, atol=1e-9)


def test_the_centre_of_mass_of_a_calm_plan_stays_in_the_middle(planned):
    planner, plan = planned
    for q in (*plan.to_crouch[1:], *plan.to_pregrasp, *plan.to_grasp):
        planner.terms.q[:], planner.terms.v[:] = q, 0.0
        planner.terms.refresh()
        x, y = planner.terms.com[:2]
        assert -0.03 < x < 0.04 and abs(y) < 0.03


def test_a_support_in_the_way_of_the_carry_state_is_refused():
    with pytest.raises(PickInfeasible, match="in the way of the carry state"):
        plan_book(replace(PICK, support=Support(top_m=0.8, near_m=0.24)))


def test_balance_pushes_against_the_offset_up_to_its_limit():
    stiff, damp = balance_gains()
    ankle, hip = (g1.ACTION_JOINTS.index(f"left_{j}_joint") for j in ("ankle_pitch", "hip_roll"))
    change = balance(np.array([0.02, -0.01]), np.array([0.1, 0.0]))
    # half of the moment for each side: 0.5 · 0.7 m · (770 N/m · 0.02 m + 150 Ns/m · 0.1 m/s) / 80 N m/rad
    assert change[ankle] == pytest.approx(0.35 * (770.0 * 0.02 + 15.0) / 80.0)
    assert change[hip] == pytest.approx(-0.35 * 7.7 / 100.0)
    np.testing.assert_allclose(balance(np.array([9.0, 0.0]), np.zeros(2)), balance(np.array([0.08, 0.0]), np.zeros(2)))
    assert np.count_nonzero(stiff) == np.count_nonzero(damp) == 4


def _table(book):
    top, near = (float(v) for v in book.support[0])
    return Scene(
        "table", obstacles=(Obstacle("support", "side", BoxShape((0.6, 0.8, top)), (near + 0.3, 0.0, top / 2)),)
    )


@pytest.mark.parametrize("noise", [0.0, 0.03])
def test_played_back_the_object_ends_in_the_carry_state_and_stays(book, noise):
    """In fine physics, without a force being read; also where readings are wrong at every step."""
    model = builder.build_model(PICK.carried, _table(book), wrist_pos=book.wrist[0], timestep_s=0.002, elliptic=True)
    model.geom_friction[[model.geom(f"{s}_palm_{i}").id for s in g1.SIDES for i in range(4)], 0] = 0.9
    data, player, rng = mujoco.MjData(model), Player(book), np.random.default_rng(0)
    data.qpos[:] = book.qpos(0)
    mujoco.mj_forward(model, data)
    memory, hits = player.start(), model.sensor("robot_hits").adr[0]
    for _ in range(book.steps + 100):
        gravity = -data.xmat[model.body("pelvis").id].reshape(3, 3)[2]
        joints = data.qpos[g1.JOINT_POS] + rng.uniform(-noise, noise, 20)
        read, gyro = gravity + rng.uniform(-1, 1, 3) * noise, data.qvel[3:6] + rng.uniform(-5, 5, 3) * noise
        target, memory = player.step(memory, joints, read, gyro)
        data.ctrl[:] = target
        mujoco.mj_step(model, data, 10)
        assert data.sensordata[hits] == 0
    off = data.qpos[g1.OBJECT_POS] - data.qpos[:3] - book.end[0]
    assert np.linalg.norm(off) < 0.03
    assert player.phase(memory) == "hold"


def test_a_book_is_read_as_it_was_written(book, tmp_path):
    both = PickBook.join([book, book])
    both.save(tmp_path / "picks.npz")
    read = PickBook.load(tmp_path / "picks.npz")
    for name, value in vars(both).items():
        np.testing.assert_array_equal(getattr(read, name), value)
    assert read.carried(1) == PICK.carried
    np.testing.assert_array_equal(read.rows([1]).target, book.target)
    with pytest.raises(InvalidState, match="row 2 of a book"):
        Player(read, 2)


def test_draws_are_of_the_range_and_give_up_in_words():
    draws, rng = PickRange(top_m=(0.5, 0.6)), np.random.default_rng(0)
    picks = [draws.sample(rng) for _ in range(50)]
    assert all(0.5 <= p.support.top_m <= 0.6 and abs(p.y_m) <= 0.05 and abs(p.yaw_rad) <= 0.2618 for p in picks)
    assert max(abs(p.yaw_rad) for p in picks) > 0.2
    with pytest.raises(PickInfeasible, match="only 0 of 1 picks could be planned"):
        draw_books(PickRange(top_m=(0.8, 0.8)), 1, tries=2)
