"""Picking up: plans that keep their promises, guards of the phase machine, bad input, one whole pick per shape."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("pinocchio")
pytest.importorskip("proxsuite")
pytest.importorskip("pydrake")
pytest.importorskip("adam.casadi")

from benchmarks.pickup import NEAR_M, Trial, run
from hotice.control.pick_plan import Planner, Support
from hotice.control.pick_plan.paths.trajectory import JOINT_SPEED
from hotice.control.pick_plan.task import COM_BOX_M, frames_at
from hotice.control.pickup import Pickup, PickupConfig, Stance
from hotice.control.pickup.footwork import ease
from hotice.control.pickup.machine import along
from hotice.control.pickup.tracking import Tracking
from hotice.control.whole_body.terms import FEET, LEFT_HAND, Terms
from hotice.errors import CarryInfeasible, HoticeError, InvalidConfig, PickInfeasible
from hotice.model import Box, Cylinder, Sphere, g1
from hotice.model.frames import quat_from_axis_angle, quat_from_yaw, quat_mul, quat_rotate, quat_to_mat
from hotice.model.joint_limits import torque_limits

BOX, TOP_M = Box((0.26, 0.28, 0.28), 1.5), 0.52
PLACE, QUAT = np.array([NEAR_M + 0.02 + 0.13, 0.02, TOP_M + 0.14]), quat_from_yaw(0.1)
OBJECTS = [BOX, Cylinder(0.13, 0.30, 1.0), Sphere(0.14, 1.0)]


@pytest.fixture(scope="module")
def pickup():
    return Pickup(BOX, Support(top_m=TOP_M, near_m=NEAR_M), PLACE, QUAT)


@pytest.fixture
def standing(pickup):
    """What the controller would measure: standing ready, the object in its place, nothing touched."""
    from hotice.control.controller import Measurement

    q, zero = pickup.start_q, np.zeros(3)
    return Measurement(
        time_s=0.0,
        joint_pos=q[7:],
        joint_vel=np.zeros(20),
        p_WP=q[:3],
        quat_WP=np.roll(q[3:7], 1),
        v_WP=zero,
        w_WP_P=zero,
        p_WO=PLACE,
        quat_WO=QUAT,
        v_WO=zero,
        w_WO_O=zero,
        foot_force_W=np.zeros((2, 3)),
        hand_force_W=np.zeros((2, 3)),
    )


def drive(pickup, memory, measurement, seconds, **change):
    """Steps with a measurement that only ages; returns command and memory."""
    command = None
    for _ in range(round(seconds * pickup.rate_hz)):
        measurement = replace(measurement, time_s=measurement.time_s + 1.0 / pickup.rate_hz, **change)
        command, memory = pickup.step(memory, measurement)
    return command, memory, measurement


@pytest.mark.parametrize("carried", OBJECTS, ids=lambda o: o.shape)
def test_plans_keep_their_promises(carried):
    """Feet stay, palms come to the sides, the object keeps its place in the hands, the weight stays over the feet."""
    planner = Planner(carried, Support(top_m=TOP_M, near_m=NEAR_M))
    half = carried.half_extents_m
    place = np.array([NEAR_M + 0.02 + half[0], 0.02, TOP_M + half[2]])
    q = planner.start_q
    plan, t = planner.plan(q, place, quat_from_yaw(0.0)), planner.terms
    t.q[:] = q
    t.refresh()
    feet = t.p_WF[FEET].copy()
    hands = frames_at(t, plan.grasp)
    relative = hands.R[0].T @ hands.R[1]
    apart = hands.R[0].T @ (hands.p[1] - hands.p[0])
    np.testing.assert_allclose(hands.p.mean(axis=0)[1], 0.02, atol=0.01)
    for path, seconds in (
        (plan.to_crouch, 2.0),
        (plan.to_pregrasp, 1.5),
        (plan.to_grasp, 1.0),
        (plan.retreat[:5], 1.8),
        (plan.retreat[4:], planner.durations.retreat_s),
    ):
        speed = 1.875 * np.abs(np.diff(path[:, 7:], axis=0)).max() * (len(path) - 1) / seconds
        assert speed < JOINT_SPEED + 1e-3
        for knot in path:
            t.q[:] = knot
            t.refresh()
            np.testing.assert_allclose(t.p_WF[FEET], feet, atol=0.001)
            assert (t.lower <= knot[7:]).all() and (knot[7:] <= t.upper).all()
            assert (t.com[:2] > COM_BOX_M[0] - 0.04).all() and (t.com[:2] < COM_BOX_M[1] + 0.02).all()
    for a, b in ((plan.to_crouch, plan.to_pregrasp), (plan.to_pregrasp, plan.to_grasp), (plan.to_grasp, plan.retreat)):
        np.testing.assert_allclose(a[-1], b[0], atol=1e-9)
    for knot in plan.to_pregrasp[1:]:
        assert frames_at(t, knot).p[:, 2].min() > TOP_M + 0.04
    for knot in plan.retreat:
        now = frames_at(t, knot)
        np.testing.assert_allclose(now.R[0].T @ (now.p[1] - now.p[0]), apart, atol=0.003)
        turned = now.R[0].T @ now.R[1] @ relative.T
        assert np.arccos(np.clip(0.5 * (np.trace(turned) - 1), -1, 1)) < np.radians(1.5)
    np.testing.assert_allclose(plan.retreat[0], plan.grasp)
    risen = frames_at(t, plan.retreat[plan.lift_knots]).p - hands.p
    np.testing.assert_allclose(risen.mean(axis=0), [0.0, 0.0, planner.rise_m], atol=0.003)


def test_paths_start_and_end_at_rest():
    import pinocchio as pin

    from hotice.control.whole_body.terms import robot_model

    model = robot_model()
    knots = np.stack([pin.neutral(model)] * 3)
    knots[1, 7:], knots[2, 7:] = 0.1, 0.3
    np.testing.assert_allclose(along(pin, model, knots, 0.0), knots[0])
    np.testing.assert_allclose(along(pin, model, knots, 1.0), knots[2])
    np.testing.assert_allclose(along(pin, model, knots, 0.5), knots[1], atol=1e-12)
    assert ease(-1) == 0 and ease(2) == 1 and ease(1e-3) < 1e-7


def test_a_hand_that_feels_nothing_tries_again_then_gives_up(pickup, standing):
    """Without contact the hands open after `touch_s`; after the last attempt the robot stands and aborts, with the
    reason."""
    memory, measurement = pickup.start(standing), standing
    c = pickup.config
    command, memory, measurement = drive(pickup, memory, measurement, 0.1 + c.settle_s + c.crouch_s + c.reach_s)
    assert command.phase == "close" and memory.attempt == 1
    _, memory, measurement = drive(pickup, memory, measurement, 0.1 + c.close_s + c.touch_s)
    assert memory.phase == "open" and not memory.failure
    memory.attempt = c.attempts
    _, memory, measurement = drive(pickup, memory, measurement, c.open_s)
    memory.attempt = c.attempts - 1
    _, memory, measurement = drive(pickup, memory, measurement, 0.2 + c.crouch_s + c.reach_s + c.close_s + c.touch_s)
    assert memory.phase == "open" and memory.failure == "hands felt nothing"
    command, memory, _ = drive(pickup, memory, measurement, 0.2 + c.open_s + c.stand_s)
    assert command.phase == "abort"
    assert [p for _, p, _ in memory.log].count("close") == 2


def lifting(pickup, standing, phase):
    """Memory in a phase of holding, forces felt."""
    memory = pickup.start(standing)
    memory.plan, memory.attempt, memory.phase = pickup.expected, 1, phase
    memory.squeeze_n, memory.load_share, memory.object_z_m = 50.0, 1.0, PLACE[2]
    felt = np.array([[0.0, 50.0, -8.0], [0.0, -50.0, -8.0]])
    return memory, replace(standing, hand_force_W=felt)


def test_an_object_that_does_not_rise_is_a_missed_grasp(pickup, standing):
    memory, measurement = lifting(pickup, standing, "lift")
    _, memory, _ = drive(pickup, memory, measurement, pickup.config.lift_s + 0.05)
    assert memory.phase == "open" and memory.log[-1][2].startswith("object rose 0 of")


def test_an_object_that_rises_goes_on(pickup, standing):
    memory, measurement = lifting(pickup, standing, "lift")
    up = PLACE + [0.0, 0.0, 0.05]
    _, memory, _ = drive(pickup, memory, measurement, pickup.config.lift_s + 0.05, p_WO=up)
    assert memory.phase in ("retreat", "back")


@pytest.mark.parametrize("phase", ["lift", "retreat", "hold"])
def test_a_lost_object_is_noticed(pickup, standing, phase):
    """Too little force for `lost_s` aborts with the reason; for a moment it does not."""
    memory, measurement = lifting(pickup, standing, phase)
    felt = measurement.hand_force_W
    _, memory, measurement = drive(pickup, memory, measurement, 0.1, hand_force_W=0.05 * felt)
    _, memory, measurement = drive(pickup, memory, measurement, 0.1, hand_force_W=felt)
    _, memory, measurement = drive(pickup, memory, measurement, 0.15, hand_force_W=0.05 * felt)
    assert memory.phase == phase
    _, memory, _ = drive(pickup, memory, measurement, 0.15, hand_force_W=0.05 * felt)
    assert memory.phase == "open" and memory.failure == f"lost the object in {phase}"


def test_an_unseen_or_unreachable_object_ends_safely(pickup, standing):
    for p_WO, why in ((None, "not seen"), (PLACE + [1.0, 0.0, 0.0], "cannot be grasped")):
        c, measurement = pickup.config, replace(standing, p_WO=p_WO)
        command, memory, _ = drive(pickup, pickup.start(measurement), measurement, 0.1 + c.settle_s + c.stand_s)
        assert command.phase == "abort" and why in memory.failure
        assert np.isfinite(command.torque).all()


@pytest.mark.parametrize("name", ["joint_pos", "p_WP", "p_WO", "hand_force_W"])
def test_measurements_that_are_not_finite_hold_and_count(pickup, standing, name):
    command, memory, measurement = drive(pickup, pickup.start(standing), standing, 0.2)
    good, broken = command.torque, getattr(standing, name).copy()
    broken.flat[0] = np.nan
    bad, after, _ = drive(pickup, memory, measurement, 0.1, **{name: broken})
    assert bad.faults == command.faults + 20 and bad.phase == "settle"
    assert np.isfinite(bad.torque).all() and (np.abs(bad.torque) <= torque_limits(g1.ACTION_JOINTS)).all()
    again, _, _ = drive(pickup, after, measurement, 0.005)
    assert again.faults == bad.faults
    np.testing.assert_allclose(again.torque, good, atol=1.0)


def moved(measurement, x, y, yaw):
    """The same instant elsewhere: turned by yaw, then shifted."""
    turn, offset = quat_from_yaw(yaw), np.array([x, y, 0.0])
    quats = {n: quat_mul(turn, getattr(measurement, n)) for n in ("quat_WP", "quat_WO")}
    places = {n: quat_rotate(turn, getattr(measurement, n)) + offset for n in ("p_WP", "p_WO")}
    ways = {n: quat_rotate(turn, getattr(measurement, n)) for n in ("v_WP", "v_WO", "foot_force_W", "hand_force_W")}
    return replace(measurement, **quats, **places, **ways)


@pytest.mark.parametrize("pose", [(1.3, -2.1, 2.4), (-0.4, 0.2, -1.0)])
def test_the_robot_may_stand_anywhere(pickup, standing, pose):
    """Stance and torques of a pick-up elsewhere are those at the origin, in every phase up to the grasp."""
    away = moved(standing, *pose)
    stance = pickup.start(away).stance
    np.testing.assert_allclose([stance.x, stance.y, stance.yaw], pose, atol=1e-9)
    here, there = (pickup.start(m) for m in (standing, away))
    assert there.plan is pickup.expected  # made at construction
    for k in range(round(pickup.rate_hz * (pickup.config.settle_s + pickup.config.crouch_s + 1.0))):
        time_s = k / pickup.rate_hz
        a, here = pickup.step(here, replace(standing, time_s=time_s))
        b, there = pickup.step(there, replace(away, time_s=time_s))
        assert a.phase == b.phase
        np.testing.assert_allclose(a.torque, b.torque, atol=0.05)
    assert a.phase == "reach"


def test_no_plan_is_made_in_a_step_while_the_object_stays(pickup, standing, monkeypatch):
    """Seen a centimetre off, the object is planned for at the start; moved later, once more."""
    made = []
    plan = pickup.planner.plan
    monkeypatch.setattr(pickup.planner, "plan", lambda *args: made.append(args) or plan(*args))
    measurement = replace(standing, p_WO=PLACE + [0.01, 0.0, 0.0])
    memory = pickup.start(measurement)
    assert len(made) == 1
    drive(pickup, memory, measurement, pickup.config.settle_s + 0.1)
    assert len(made) == 1
    command, memory, _ = drive(pickup, memory, measurement, pickup.config.settle_s + 0.1, p_WO=PLACE - [0.01, 0.0, 0.0])
    assert len(made) == 2 and command.phase == "crouch"
    np.testing.assert_allclose(memory.plan.p_GO, PLACE - [0.01, 0.0, 0.0], atol=1e-4)


def test_a_step_changes_nothing_it_is_given(pickup, standing):
    """The same memory and measurement give the same command again."""
    _, memory, measurement = drive(pickup, pickup.start(standing), standing, 0.7)
    kept = memory.copy()
    first, _ = pickup.step(memory, measurement)
    drive(pickup, memory, measurement, 0.1)
    np.testing.assert_array_equal(memory.reference, kept.reference)
    assert memory.phase == kept.phase and memory.log == kept.log
    np.testing.assert_array_equal(memory.qp.guess.x, kept.qp.guess.x)
    again, _ = pickup.step(kept, measurement)
    np.testing.assert_allclose(again.torque, first.torque, atol=1e-6)


@pytest.mark.parametrize(
    "make, error, match",
    [
        (
            lambda: Pickup(BOX, Support(top_m=0.52, near_m=0.24), PLACE + [0.8, 0, 0], QUAT),
            PickInfeasible,
            "stand nearer",
        ),
        (lambda: Pickup(BOX, Support(top_m=0.52, near_m=0.24), [0.4, np.nan, 0.6], QUAT), PickInfeasible, "3 finite"),
        (lambda: Pickup(BOX, Support(top_m=0.52, near_m=0.24), PLACE, [1.0, 0.0]), PickInfeasible, "4 finite"),
        (
            lambda: Pickup(Box((0.3, 0.3, 0.3), 20.0), Support(top_m=0.5, near_m=0.24), PLACE, QUAT),
            CarryInfeasible,
            "heavy",
        ),
        (lambda: Support(top_m=0.2, near_m=0.24), PickInfeasible, "0.20 m: allowed are 0.40 to 0.85"),
        (lambda: Support(top_m=1.2, near_m=0.24), PickInfeasible, "1.20 m: allowed are 0.40 to 0.85"),
        (lambda: Support(top_m=0.5, near_m=2.0), PickInfeasible, "stand nearer"),
        (lambda: PickupConfig(lift_s=0.0), InvalidConfig, "lift_s"),
        (lambda: PickupConfig(squeeze_n=(45.0, np.nan)), InvalidConfig, "squeeze_n"),
    ],
)
def test_bad_input_says_so(make, error, match):
    assert issubclass(error, HoticeError)
    with pytest.raises(error, match=match):
        make()


@pytest.mark.slow
@pytest.mark.parametrize("carried", OBJECTS, ids=lambda o: o.shape)
def test_a_whole_pick(carried):
    """With noise, from a low support."""
    result = run(Trial(carried, TOP_M, 0.02, 0.02, 0.1, 1.5, 3))
    assert result.cause == "", result


@pytest.mark.slow
def test_a_whole_pick_with_steps_back():
    """From a support so high that the robot steps back before it lowers the object."""
    result = run(Trial(Box((0.30, 0.26, 0.28), 2.0), 0.72, 0.02, 0.0, 0.0, 1.5, 3))
    assert result.cause == "", result


@pytest.mark.slow
def test_a_whole_pick_away_from_the_origin():
    """Standing elsewhere and facing another way; the noise of the object's place stays along the world's axes."""
    result = run(Trial(BOX, TOP_M, 0.02, 0.02, 0.1, 1.5, 3, Stance(-1.4, 2.2, 2.3)))
    assert result.cause == "", result


def test_palms_on_round_sides_are_soft_about_their_own_length(pickup, standing):
    """A palm that is off by as much is turned back by an eighth of the moment: a pair of palm spheres aligns itself."""
    true, ref, sphere = Terms(), Terms(), Sphere(0.14, 1.0)
    for t in (true, ref):
        t.q[:], t.v[:] = pickup.start_q, 0.0
        t.refresh()
    tracking, memory = Tracking(sphere, 50.0, true, ref), pickup.start(standing)
    memory.load_share, R = 1.0, true.R_WF[LEFT_HAND].copy()
    found = []
    for axis in np.eye(3):
        ref.R_WF[LEFT_HAND] = R @ np.asarray(quat_to_mat(quat_from_axis_angle(axis, np.asarray(0.05))))
        tracking.contacts.hand_moment_W[:] = 0.0
        tracking._bear(memory, tracking.contacts.hand_point)
        found.append(R.T @ tracking.contacts.hand_moment_W[0])
    np.testing.assert_allclose(found, -np.diag([5.0, 40.0, 40.0]) * np.sin(0.05), atol=1e-9)


@pytest.mark.parametrize("carried, lever", [(Sphere(0.14, 2.0), 0.03), (BOX, 0.0)])
def test_the_weight_of_round_objects_bears_inward_of_where_the_palms_press(pickup, standing, carried, lever):
    """So that both of a pair of palm spheres stay loaded: about the hands' own x, left and right opposite."""
    true, ref = Terms(), Terms()
    for t in (true, ref):
        t.q[:], t.v[:] = pickup.start_q, 0.0
        t.refresh()
    tracking, memory = Tracking(carried, 50.0, true, ref), pickup.start(standing)
    memory.load_share, tracking.contacts.load_kg = 1.0, 2.0
    tracking._bear(memory, tracking.contacts.hand_point)  # no lever ahead
    about = [true.R_WF[LEFT_HAND + h].T @ tracking.contacts.hand_moment_W[h] for h in range(2)]
    np.testing.assert_allclose(about, [[s * lever * 9.81, 0.0, 0.0] for s in (1.0, -1.0)], atol=1e-9)
