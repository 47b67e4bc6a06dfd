"""Each fault at its limit and just below it, alone and with others."""

import numpy as np
import pytest

from hotice.errors import InvalidConfig
from hotice.model import g1
from hotice.model.joint_limits import position_limits, torque_limits
from hotice.safety import RESPONSES, AgeLimits, Answer, CommandLimits, Fault, MeasurementLimits
from hotice.safety.judge import lean_ahead, measurement_array, stands_still
from hotice.safety.responses import STILL_HOLDS, response_table
from tests.safety.watch_fixture import Watch

LOWER, UPPER = position_limits(g1.ACTION_JOINTS)
MIDDLE = 0.5 * (LOWER + UPPER)
TORQUE = torque_limits(g1.ACTION_JOINTS)
UPRIGHT = np.array([1.0, 0.0, 0.0, 0.0])
GOOD = {"quat": UPRIGHT, "gyro": np.zeros(3), "q": MIDDLE, "qd": np.full(20, 0.1)}
PLACED = {"p_WP": np.array([1.0, 2.0, 0.74]), "p_WO": np.array([1.3, 2.0, 0.9]), "R_WO": np.eye(3)}


def watch(**limits):
    return Watch(LOWER, UPPER, TORQUE, **limits)


def leaning(angle):
    return np.array([np.cos(angle / 2), np.sin(angle / 2), 0.0, 0.0])


def with_one(values, index, value):
    out = np.array(values, dtype=float)
    out[index] = value
    return out


def seen(**change):
    w = watch()
    with np.errstate(all="raise"):
        w.see_state(0.0, **{**GOOD, **change})
    return w.decide(0.0).present


def placed(**change):
    w = watch()
    w.see_pose(0.0, **{**PLACED, **change})
    return w.decide(0.0).present


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("name", GOOD)
def test_a_state_that_is_not_finite(name, bad):
    for i in range(len(GOOD[name])):
        assert Fault.STATE_NOT_FINITE in seen(**{name: with_one(GOOD[name], i, bad)})


@pytest.mark.parametrize(
    "change, fault",
    [
        ({}, None),
        ({"quat": np.zeros(4)}, Fault.QUATERNION),
        ({"quat": 1.11 * UPRIGHT}, Fault.QUATERNION),
        ({"quat": 1.09 * UPRIGHT}, None),
        ({"quat": -0.91 * UPRIGHT}, None),
        ({"quat": 0.89 * UPRIGHT}, Fault.QUATERNION),
        ({"quat": 1e200 * UPRIGHT}, Fault.QUATERNION),
        ({"quat": leaning(0.89)}, None),
        ({"quat": -1.05 * leaning(0.91)}, Fault.FALLING),
        ({"quat": leaning(0.6), "gyro": np.array([1.9, 0.0, 0.0])}, None),
        ({"quat": leaning(0.6), "gyro": np.array([2.1, 0.0, 0.0])}, Fault.FALLING),
        ({"quat": leaning(0.6), "gyro": np.array([-2.1, 0.0, 5.0])}, None),
        ({"quat": leaning(0.99), "gyro": np.array([-1.0, 0.0, 0.0])}, None),
        ({"quat": leaning(1.01), "gyro": np.array([-1.0, 0.0, 0.0])}, Fault.TILT),
        ({"quat": -1.05 * leaning(1.01), "gyro": np.array([-1.0, 0.0, 0.0])}, Fault.TILT),
        ({"quat": leaning(np.pi)}, (Fault.TILT, Fault.FALLING)),
        ({"gyro": np.array([0.0, -5.9, 0.0])}, None),
        ({"gyro": np.array([0.0, -6.1, 0.0])}, (Fault.GYRO, Fault.FALLING)),
        ({"gyro": np.array([0.0, 1e6, 0.0])}, Fault.STATE_IMPOSSIBLE),
        ({"qd": with_one(GOOD["qd"], 3, -19.9)}, None),
        ({"qd": with_one(GOOD["qd"], 3, -30.1)}, Fault.JOINT_SPEED),
        ({"qd": with_one(GOOD["qd"], 3, 1e6)}, Fault.STATE_IMPOSSIBLE),
        ({"q": with_one(MIDDLE, 3, UPPER[3] + 0.09)}, None),
        ({"q": with_one(MIDDLE, 3, UPPER[3] + 0.11)}, Fault.JOINT_LIMIT),
        ({"q": with_one(MIDDLE, 4, LOWER[4] - 0.11)}, Fault.JOINT_LIMIT),
        ({"q": with_one(MIDDLE, 4, LOWER[4] - 1.0)}, Fault.STATE_IMPOSSIBLE),
    ],
)
def test_a_state(change, fault):
    assert seen(**change) == (() if fault is None else fault if isinstance(fault, tuple) else (fault,))


def test_the_lean_ahead():
    """By finite differences: turned on at the gyro's rate, a body leans so much more."""
    from hotice.model.frames import quat_from_axis_angle, quat_mul, quat_rotate

    def lean(quat):
        return np.arccos(quat_rotate(quat, np.array([0.0, 0.0, 1.0]))[2])

    rng = np.random.default_rng(0)
    for _ in range(20):
        quat = quat_from_axis_angle(np.array([*rng.normal(size=2), 0.0]), rng.uniform(0.1, 1.4))
        quat = quat_mul(quat_mul(quat_from_axis_angle(np.array([0.0, 0.0, 1.0]), rng.normal()), quat), UPRIGHT)
        gyro, dt = rng.normal(size=3), 1e-6
        later = quat_mul(quat, quat_from_axis_angle(gyro, dt * np.linalg.norm(gyro)))
        expected = lean(quat) + 0.15 * (lean(later) - lean(quat)) / dt
        assert lean_ahead(quat, gyro, 0.15) == pytest.approx(expected, abs=1e-6)
    assert lean_ahead(UPRIGHT, np.array([0.3, -0.4, 9.0]), 0.15) == pytest.approx(0.075)


def test_a_robot_is_damped_when_two_measurements_say_that_it_falls():
    w, answers = watch(), []
    for k, lean in enumerate((0.5, 0.95, 0.5, 0.95, 0.95)):
        w.see_state(0.02 * k, **{**GOOD, "quat": leaning(lean), "qd": np.full(20, 0.1 + 0.01 * k)})
        answers.append(w.decide(0.02 * k).answer)
    assert answers == [Answer.PASS] * 4 + [Answer.DAMP] and w.counts[Fault.FALLING] == 3


@pytest.mark.parametrize(
    "change, fault",
    [
        ({}, None),
        ({"p_WP": np.array([1.0, 2.0, -0.1]), "p_WO": np.array([1.3, 2.0, 0.1])}, Fault.POSE_INVALID),
        ({"p_WP": np.array([1.0, np.nan, 0.74])}, Fault.POSE_INVALID),
        ({"p_WP": np.array([1.0, 2.0, 1.6])}, Fault.POSE_INVALID),
        ({"p_WP": np.array([1.0, 2.0, 0.34])}, Fault.PELVIS_LOW),
        ({"p_WP": np.array([1.0, 2.0, 0.36])}, None),
        ({"p_WO": np.array([1.99, 2.0, 0.74])}, None),
        ({"p_WO": np.array([2.01, 2.0, 0.74])}, Fault.BOX_INVALID),
        ({"p_WO": np.array([np.nan, 2.0, 0.74])}, Fault.BOX_INVALID),
        ({"p_WO": np.array([1e300, 2.0, 0.74])}, Fault.BOX_INVALID),
        ({"R_WO": np.full((3, 3), np.nan)}, Fault.BOX_INVALID),
        ({"R_WO": 1.2 * np.eye(3)}, Fault.BOX_INVALID),
        ({"R_WO": np.zeros((3, 3))}, Fault.BOX_INVALID),
    ],
)
def test_a_pose(change, fault):
    assert placed(**change) == (() if fault is None else (fault,))


def test_targets():
    w = watch(command=CommandLimits(target_margin_rad=0.2, step_rad=0.35))
    assert w.see_targets(0.0, MIDDLE)
    for bad, fault in (
        (with_one(MIDDLE, 3, np.nan), Fault.COMMAND_NOT_FINITE),
        (with_one(MIDDLE, 3, 1e9), Fault.COMMAND_RANGE),
        (with_one(MIDDLE, 3, UPPER[3] + 0.21), Fault.COMMAND_RANGE),
        (with_one(MIDDLE, 3, MIDDLE[3] + 0.36), Fault.COMMAND_STEP),
    ):
        assert not w.see_targets(0.0, bad)
        assert w.decide(0.0).present == (fault,)
        np.testing.assert_array_equal(w.last, MIDDLE)
    step = with_one(MIDDLE, 3, MIDDLE[3] + 0.34)
    assert w.see_targets(0.02, step)
    np.testing.assert_array_equal(w.last, step)
    assert w.decide(0.02).fault is Fault.NONE


def test_torques():
    w = watch()
    assert w.see_torques(0.0, TORQUE) and w.see_torques(0.0, -TORQUE)
    assert w.decide(0.0).present == ()
    assert not w.see_torques(0.02, with_one(TORQUE, 2, 1e9))
    assert w.decide(0.02).present == (Fault.COMMAND_RANGE,)
    assert not w.see_torques(0.04, with_one(TORQUE, 2, -np.inf))
    assert w.decide(0.04).present == (Fault.COMMAND_NOT_FINITE,)


def ages(now=1.0, state=1.0, command=1.0, pose=1.0, box=1.0):
    return {"now_s": now, "state_s": state, "command_s": command, "pose_s": pose, "box_s": box}


@pytest.mark.parametrize(
    "changed, fault, answer",
    [
        ({}, None, Answer.PASS),
        ({"state": 0.981}, None, Answer.PASS),
        ({"state": 0.97}, Fault.STATE_LATE, Answer.PASS),
        ({"state": 0.94}, Fault.STATE_LATE, Answer.DAMP),
        ({"state": np.nan}, Fault.STATE_MISSING, Answer.PASS),
        ({"command": 0.97}, None, Answer.PASS),
        ({"command": 0.95}, Fault.COMMAND_LATE, Answer.REPEAT),
        ({"command": 0.945}, Fault.COMMAND_LATE, Answer.REPEAT),
        ({"command": 0.94}, Fault.COMMAND_LATE, Answer.DAMP),
        ({"command": np.nan}, Fault.COMMAND_LATE, Answer.REPEAT),
        ({"pose": 0.71}, None, Answer.PASS),
        ({"pose": 0.5}, Fault.POSE_LATE, Answer.PASS),
        ({"pose": 0.0}, Fault.POSE_LATE, Answer.STOP_WALKING),
        ({"box": 0.91}, None, Answer.PASS),
        ({"box": 0.7}, Fault.BOX_LATE, Answer.PASS),
        ({"box": 0.5}, Fault.BOX_LATE, Answer.STOP_WALKING),
    ],
)
def test_ages(changed, fault, answer):
    w = watch()
    w.see_ages(**ages(**changed))
    decision = w.decide(1.0)
    assert decision.present == (() if fault is None else (fault,)) and decision.answer is answer


def test_a_tick_that_stands_still_and_numbers_that_do():
    w = watch()
    for now in (1.0, 1.01, 1.02, 1.03, 1.05):
        w.see_ages(**ages(now=now, state=1.0, command=now, pose=now, box=now))
        decision = w.decide(now)
        assert (Fault.STATE_FROZEN in decision.present) is (now >= 1.02)
        assert (decision.answer is Answer.DAMP) is (now >= 1.05)
    w = watch()
    for now in (1.0, 1.01, 1.02, 1.03, 1.05):
        w.see_state(now, **GOOD)
        w.see_ages(**ages(now=now, state=now, command=now, pose=now, box=now))
        decision = w.decide(now)
        assert (Fault.STATE_FROZEN in decision.present) is (now >= 1.02)
        assert (decision.answer is Answer.DAMP) is (now >= 1.05)
    w = watch()
    for now in (1.0, 1.02, 1.04, 1.06):
        w.see_state(now, **{**GOOD, "qd": np.zeros(20)})
        w.see_ages(**ages(now=now, state=now, command=now, pose=now, box=now))
        assert w.decide(now).present == (), "a robot at rest may measure the same again"


def test_what_comes_late_but_regularly_grows_no_older():
    w = watch()
    for k in range(50):
        now = 1.0 + 0.002 * k
        w.see_ages(**ages(now=now, state=now - 0.04, command=now, pose=now, box=now))
        decision = w.decide(now)
        assert decision.present == (Fault.STATE_LATE,) and decision.answer is Answer.PASS


def test_no_state_for_50_ms_is_damped():
    w = watch()
    answers = []
    for now in (1.0, 1.02, 1.04, 1.06):
        w.see_ages(**ages(now=now, state=np.nan, command=now, pose=now, box=now))
        answers.append(w.decide(now).answer)
    assert answers == [Answer.PASS, Answer.PASS, Answer.PASS, Answer.DAMP]


def test_damping_wins_over_holding_over_stopping():
    w = watch()
    w.see(Fault.GUIDANCE_INVALID, 0.0)
    assert w.decide(0.0).answer is Answer.STOP_WALKING
    w.see(Fault.GUIDANCE_INVALID, 0.02)
    w.see_state(0.02, **{**GOOD, "q": with_one(MIDDLE, 3, UPPER[3] + 0.11)})
    decision = w.decide(0.02)
    assert decision.answer is Answer.STOP_WALKING and decision.present[0] is Fault.JOINT_LIMIT
    w = watch()
    for now in (0.0, 0.06):
        w.see(Fault.GUIDANCE_INVALID, now)
        w.see(Fault.CONTROLLER_ERROR, now)
        decision = w.decide(now, still=True)
    assert decision.answer is Answer.HOLD and decision.fault is Fault.CONTROLLER_ERROR
    w.see_targets(0.04, np.full(20, np.nan))
    w.see(Fault.CONTROLLER_ERROR, 0.04)
    w.see_state(0.04, **{**GOOD, "quat": leaning(1.2), "q": with_one(MIDDLE, 3, np.nan)})
    decision = w.decide(0.04)
    assert decision.answer is Answer.DAMP and decision.fault is Fault.TILT
    assert decision.present == (
        Fault.TILT,
        Fault.STATE_NOT_FINITE,
        Fault.COMMAND_NOT_FINITE,
        Fault.CONTROLLER_ERROR,
    )


def test_damping_is_final_until_reset():
    w = watch()
    w.see_state(0.0, **{**GOOD, "quat": leaning(1.2)})
    w.decide(0.0)
    for now in (0.02, 0.04):
        w.see_state(now, **GOOD)
        decision = w.decide(now)
        assert decision.answer is Answer.DAMP and decision.fault is Fault.TILT and decision.present == ()
    assert w.counts[Fault.TILT] == 1
    w.reset()
    w.see_state(0.06, **GOOD)
    assert w.decide(0.06).answer is Answer.PASS


def test_a_failing_controller_is_repeated_over_then_damped_or_held():
    w, answers, still = watch(), [], []
    for k in range(7):
        w.see(Fault.CONTROLLER_ERROR, 0.02 * k)
        answers.append(w.decide(0.02 * k).answer)
    assert answers == [Answer.REPEAT] * 3 + [Answer.DAMP] * 4
    assert w.counts[Fault.CONTROLLER_ERROR] == 7
    w = watch()
    for k in range(7):
        w.see(Fault.CONTROLLER_ERROR, 0.02 * k)
        still.append(w.decide(0.02 * k, still=True).answer)
    assert still == [Answer.REPEAT] * 3 + [Answer.HOLD] * 4, "a robot that stands still goes on standing"
    assert w.decide(0.14).answer is Answer.PASS, "it is over"


def test_standing_still():
    assert stands_still(UPRIGHT, np.zeros(3), np.full(20, 0.4))
    assert not stands_still(UPRIGHT, np.zeros(3), with_one(np.zeros(20), 7, -0.6))
    assert not stands_still(UPRIGHT, np.array([0.0, 0.4, 0.0]), np.zeros(20))
    assert not stands_still(leaning(0.5), np.zeros(3), np.zeros(20))
    assert not stands_still(UPRIGHT, np.zeros(3), with_one(np.zeros(20), 7, np.nan))
    assert not stands_still(np.full(4, np.nan), np.zeros(3), np.zeros(20))


def answer_to(fault, lasted_s, still=False):
    w = watch()
    w.see(fault, 0.0)
    return w.decide(lasted_s, still).answer


def test_every_fault_has_an_answer_and_only_falls_damp_at_once():
    assert RESPONSES.keys() == set(Fault) - {Fault.NONE}
    for fault, response in RESPONSES.items():
        times, answers = zip(*response, strict=True)
        assert times[0] == 0.0 and list(times) == sorted(times) and list(answers) == sorted(answers)
        assert (answer_to(fault, 0.0) is Answer.DAMP) is (fault >= Fault.JOINT_SPEED)
    state = {f for f in Fault if Fault.STATE_LATE <= f <= Fault.STATE_NOT_FINITE}
    assert all(answer_to(f, 0.05) is Answer.DAMP and answer_to(f, 0.049) is not Answer.DAMP for f in state)
    assert all(answer_to(f, 60.0) is Answer.STOP_WALKING for f in Fault if Fault.NONE < f <= Fault.GUIDANCE_INVALID)
    assert all(answer_to(f, 60.0, still=True) is Answer.HOLD for f in STILL_HOLDS)
    assert all(answer_to(f, 60.0, still=True) is Answer.DAMP for f in Fault if f >= Fault.STATE_LATE)
    table = response_table()
    assert table[Fault.BOX_LATE, Answer.STOP_WALKING] == 0.5 and np.isinf(table[Fault.NONE]).all()


@pytest.mark.parametrize(
    "kind, name", [(MeasurementLimits, "gyro_rad_s"), (CommandLimits, "step_rad"), (AgeLimits, "box_s")]
)
@pytest.mark.parametrize("value", [np.nan, 0.0, -1.0, np.inf])
def test_limits_are_checked(kind, name, value):
    with pytest.raises(InvalidConfig, match=f"{name} is .*: a finite number above 0.* is needed"):
        kind(**{name: value})


def test_the_limits_reach_the_judge():
    assert measurement_array(MeasurementLimits(tilt_rad=np.pi))[1] == -1.0
    assert len(measurement_array(MeasurementLimits())) == len(vars(MeasurementLimits()))
