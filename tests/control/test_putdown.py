"""Putting down: a plan run backwards, its guards, bad input, one whole put-down per shape."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("pinocchio")
pytest.importorskip("proxsuite")
pytest.importorskip("pydrake")
pytest.importorskip("adam.casadi")

from benchmarks.pickup import NEAR_M, Trial
from benchmarks.putdown import holding, run
from hotice.control import Measurement
from hotice.control.pick_plan import Support
from hotice.control.pickup import Stance
from hotice.control.putdown import PUT_DOWN_PHASES, PutDown, PutDownConfig
from hotice.errors import CarryInfeasible, InvalidConfig, PickInfeasible, PutDownInfeasible
from hotice.model import Box, Cylinder, Sphere
from hotice.model.frames import quat_from_yaw, quat_mul, quat_rotate

BOX, TOP_M = Box((0.26, 0.28, 0.28), 1.5), 0.52
PLACE, QUAT = np.array([NEAR_M + 0.02 + 0.13, 0.02, TOP_M + 0.14]), quat_from_yaw(0.0)
TRIAL = Trial(BOX, TOP_M, 0.02, 0.02, 0.0, 1.5, 3)
HERE, AWAY = Stance(), Stance(-0.1, 0.08, 0.15)


@pytest.fixture(scope="module")
def putdown():
    return PutDown(BOX, Support(top_m=TOP_M, near_m=NEAR_M), PLACE, QUAT)


def measured(putdown, away=HERE, time_s=0.0):
    """What the controller would measure: the carry state at rest, `away` from where the plan has the feet."""
    q, zero = holding(putdown, TRIAL, away), np.zeros(3)
    return Measurement(
        time_s=time_s,
        joint_pos=q[7:27],
        joint_vel=np.zeros(20),
        p_WP=q[:3],
        quat_WP=q[3:7],
        v_WP=zero,
        w_WP_P=zero,
        p_WO=q[27:30],
        quat_WO=q[30:34],
        v_WO=zero,
        w_WO_O=zero,
        foot_force_W=np.array([[0.0, 0.0, 180.0]] * 2),
        hand_force_W=np.array([[0.0, 50.0, -8.0], [0.0, -50.0, -8.0]]),
    )


def drive(putdown, memory, m, seconds, **change):
    """Steps with a measurement that only ages; returns command, memory and the newest measurement."""
    command = None
    for _ in range(round(seconds * putdown.rate_hz)):
        m = replace(m, time_s=m.time_s + 1.0 / putdown.rate_hz, **change)
        command, memory = putdown.step(memory, m)
    return command, memory, m


def test_the_reference_goes_the_way_of_a_pick_up_backwards(putdown):
    """From the carry state over the place, down to the grasp, hands off, standing with the arms drawn back."""
    m, c = measured(putdown), putdown.config
    memory = putdown.start(m)
    ends = {}
    for _ in range(round(20.0 * c.rate_hz)):
        m = replace(m, time_s=m.time_s + 1.0 / c.rate_hz)
        if memory.phase == "lower" and m.time_s - memory.since_s > c.lower_s - 0.01:
            m = replace(m, p_WO=PLACE)
        before = memory
        _, memory = putdown.step(memory, m)
        if memory.phase != before.phase:
            ends[before.phase] = memory.reference
        if memory.phase == "adjust":
            m = replace(m, p_WO=PLACE + [0.0, 0.0, 0.06])
    assert list(ends) == [p for p in PUT_DOWN_PHASES if p not in ("approach", "ahead", "done", "abort")]
    plan = putdown.plan
    np.testing.assert_allclose(ends["raise"][7:], plan.retreat[plan.lift_knots][7:], atol=1e-9)
    np.testing.assert_allclose(ends["lower"][7:], plan.grasp[7:], atol=0.01)
    np.testing.assert_allclose(ends["withdraw"], plan.crouch, atol=1e-9)
    np.testing.assert_allclose(memory.reference, plan.to_crouch[0], atol=1e-9)
    assert memory.phase == "done" and memory.squeeze_n == memory.load_share == 0.0


def test_feet_that_are_elsewhere_step_to_their_place(putdown):
    for away, phase in ((Stance(), "raise"), (Stance(0.0, 0.01, 0.0), "raise"), (AWAY, "approach")):
        m = measured(putdown, away)
        command, memory, _ = drive(putdown, putdown.start(m), m, putdown.config.settle_s + 0.1)
        assert command.phase == phase and np.isfinite(command.torque).all()
    end = memory.course.feet_at(memory.course.seconds).pose
    np.testing.assert_allclose(end[:, :2].mean(axis=0) + [0.035, 0.0], 0.0, atol=1e-6)
    np.testing.assert_allclose(end[:, 3], 0.0, atol=1e-6)


def test_hands_correct_where_the_object_is_in_them(putdown):
    """Seen 2 cm to the left over its place, the object is carried 2 cm to the right; never farther than `shift_m`."""
    for seen, moved in ((0.02, 0.02), (0.5, putdown.config.shift_m)):
        m, memory = measured(putdown), putdown.start(measured(putdown))
        plan = putdown.plan
        memory.phase, memory.reference = "raise", plan.retreat[plan.lift_knots]
        memory.since_s = -putdown.config.raise_s
        over = PLACE + [0.0, seen, putdown._phases._rise_m()]
        _, memory, m = drive(putdown, memory, m, putdown.config.adjust_s + 0.1, p_WO=over)
        assert memory.phase == "lower"
        np.testing.assert_allclose(memory.shift, [0.0, -moved, 0.0], atol=2e-4)
        np.testing.assert_allclose(memory.reference[1] - plan.retreat[plan.lift_knots][1], -moved, atol=2e-3)


@pytest.mark.parametrize("phase", ["raise", "lower"])
def test_a_lost_object_is_noticed(putdown, phase):
    m, memory = measured(putdown), putdown.start(measured(putdown))
    memory.phase, weak = phase, 0.05 * m.hand_force_W
    _, memory, m = drive(putdown, memory, m, 0.1, hand_force_W=weak)
    assert memory.phase == phase
    c = putdown.config
    _, memory, m = drive(putdown, memory, m, 0.2, hand_force_W=weak)
    assert memory.phase == "open" and memory.failure == f"lost the object in {phase}"
    command, memory, _ = drive(putdown, memory, m, c.open_s + c.withdraw_s + c.rise_s + 0.1)
    assert command.phase == "abort" and memory.failure


def test_told_to_stand_it_waits(putdown):
    m = measured(putdown)
    memory = putdown.start(m)
    _, memory, m = drive(putdown, memory, m, 2.0 * putdown.config.settle_s, stand=True)
    assert memory.phase == "catch"
    _, memory, _ = drive(putdown, memory, m, putdown.config.settle_s + 0.1, stand=False)
    assert memory.phase == "raise"


def test_it_stands_where_the_support_is_too_far(putdown):
    m = measured(putdown, Stance(-1.5, 0.0, 0.0))
    command, memory, _ = drive(putdown, putdown.start(m), m, 2.0)
    assert command.phase == "done" and memory.squeeze_n == putdown.squeeze_n
    assert memory.failure.startswith("the robot stands 1.50 m from") and "walk there first" in memory.failure


def test_the_support_may_be_anywhere(putdown):
    """Torques of a put-down elsewhere are those at the origin."""
    pose = (1.3, -2.1, 2.4)
    there = PutDown(BOX, Support(top_m=TOP_M, near_m=NEAR_M), PLACE, QUAT, stance=Stance(*pose))
    a = measured(putdown, AWAY)
    turn, offset = quat_from_yaw(pose[2]), np.array([*pose[:2], 0.0])
    places = {n: quat_rotate(turn, getattr(a, n)) + offset for n in ("p_WP", "p_WO")}
    quats = {n: quat_mul(turn, getattr(a, n)) for n in ("quat_WP", "quat_WO")}
    forces = {n: quat_rotate(turn, getattr(a, n)) for n in ("foot_force_W", "hand_force_W")}
    b = replace(a, **places, **quats, **forces)
    here, away, _ = *drive(putdown, putdown.start(a), a, 2.0)[:2], None
    far, off, _ = *drive(there, there.start(b), b, 2.0)[:2], None
    assert here.phase == far.phase == "approach"
    np.testing.assert_allclose(here.torque, far.torque, atol=0.1)
    np.testing.assert_allclose(away.reference, off.reference, atol=1e-6)


def test_an_object_is_put_down_as_it_is_held():
    """The palms' height on the object is that of the pick-up, though the support would suggest another."""
    carried = Box((0.3, 0.3, 0.4), 1.0)
    place = np.array([NEAR_M + 0.02 + 0.15, 0.0, 0.72 + 0.2])
    own, held = (
        PutDown(carried, Support(top_m=0.72, near_m=NEAR_M), place, QUAT, grasp_above_m=a) for a in (None, 0.04)
    )
    assert held.planner.above_m == 0.04 != own.planner.above_m
    assert abs(own.plan.p_OH[0, 2] - held.plan.p_OH[0, 2]) > 0.005


@pytest.mark.parametrize(
    "make, error, match",
    [
        (
            lambda: PutDown(BOX, Support(top_m=0.52, near_m=0.24), PLACE + [0.8, 0, 0], QUAT),
            PutDownInfeasible,
            "the box cannot be put down on a support 0.52 m high, 0.24 m ahead: .*stand nearer",
        ),
        (
            lambda: PutDown(BOX, Support(top_m=0.52, near_m=0.24), [0.4, np.nan, 0.6], QUAT),
            PutDownInfeasible,
            "3 finite",
        ),
        (
            lambda: PutDown(Box((0.3, 0.3, 0.3), 20.0), Support(top_m=0.5, near_m=0.24), PLACE, QUAT),
            CarryInfeasible,
            "heavy",
        ),
        (lambda: Support(top_m=1.2, near_m=0.24), PickInfeasible, "1.20 m: allowed are 0.40 to 0.85"),
        (lambda: PutDownConfig(lower_s=0.0), InvalidConfig, "lower_s"),
        (lambda: PutDownConfig(squeeze_n=(45.0, np.nan)), InvalidConfig, "squeeze_n"),
    ],
)
def test_bad_input_says_so(make, error, match):
    with pytest.raises(error, match=match):
        make()


@pytest.mark.slow
@pytest.mark.parametrize("carried", [BOX, Cylinder(0.13, 0.30, 1.0), Sphere(0.14, 1.0)], ids=lambda o: o.shape)
def test_a_whole_put_down(carried):
    """With noise, steps to the support first: within 5 cm, upright, hands off it, standing for 2 s."""
    result = run(replace(TRIAL, carried=carried), away=AWAY)
    assert result.cause == "", result
    assert result.off_m < 0.05 and result.apart_m > 0.05


@pytest.mark.slow
def test_a_whole_put_down_on_a_high_support():
    """The object is raised over the support before the robot steps up to it."""
    phases = []
    trial = Trial(Box((0.30, 0.26, 0.28), 2.0), 0.74, 0.02, 0.0, 0.0, 1.5, 3, Stance(-1.4, 2.2, 2.3))
    result = run(trial, away=AWAY, watch=lambda plant, command, memory: phases.append(command.phase))
    assert result.cause == "", result
    assert "ahead" in phases


def test_a_marching_robot_is_taken_over_only_where_it_can_come_to_rest(putdown):
    """A foot that comes down is caught; not one that rises, or is high, nor a robot on its way aside or ahead."""
    m = measured(putdown)
    assert putdown.catches(m)
    lifted = m.joint_pos.copy()
    # a bent knee and hip lift the left foot by some centimetres
    lifted[[0, 3, 4]] += [-0.12, 0.24, -0.12]
    down, up = np.zeros(20), np.zeros(20)
    down[[0, 3, 4]], up[[0, 3, 4]] = [0.5, -1.0, 0.5], [-0.5, 1.0, -0.5]
    assert putdown.catches(replace(m, joint_pos=lifted, joint_vel=down))
    assert not putdown.catches(replace(m, joint_pos=lifted, joint_vel=up))
    high = m.joint_pos.copy()
    high[[0, 3, 4]] += [-0.5, 1.0, -0.5]
    assert not putdown.catches(replace(m, joint_pos=high, joint_vel=down))
    for v_WP in ([0.6, 0.0, 0.0], [0.0, 0.6, 0.0], [0.0, 0.0, -0.5]):
        assert not putdown.catches(replace(m, v_WP=np.array(v_WP)))
    assert not putdown.catches(replace(m, w_WP_P=np.array([0.0, 0.0, 2.0])))
    assert not putdown.catches(replace(m, p_WP=np.full(3, np.nan)))


def test_a_foot_in_the_air_comes_down_first(putdown):
    """Straight down where it is, and only then does the body move; the floor ends it, or half a second."""
    m = measured(putdown)
    lifted = m.joint_pos.copy()
    lifted[[0, 3, 4]] += [-0.2, 0.4, -0.2]
    m = replace(m, joint_pos=lifted, foot_force_W=np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 360.0]]))
    memory = putdown.start(m)
    np.testing.assert_array_equal(memory.air, [True, False])
    command, memory, m = drive(putdown, memory, m, 0.2)
    assert command.phase == "catch" and memory.air[0]
    both = np.array([[0.0, 0.0, 180.0]] * 2)
    command, memory, _ = drive(putdown, memory, m, 0.02, foot_force_W=both)
    assert command.phase == "settle" and not memory.air.any()
