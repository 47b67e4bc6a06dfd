"""The fault table row by row: at its limit nothing, just beyond it the answer. Pure functions."""

import numpy as np
import pytest

from hotice.deploy.guard import faults
from hotice.deploy.guard.faults import Reaction
from hotice.deploy.guard.limits import GuardLimits
from hotice.deploy.guard.measured import jumped
from hotice.deploy.guard.targets import refusal
from hotice.deploy.slot.records import TARGETS
from hotice.errors import InvalidConfig
from hotice.model import g1
from hotice.model.joint_limits import position_limits, torque_limits

LIMITS = GuardLimits()
NONE, WARN, HOLD, LOWER, DAMPING = Reaction
LOWEST, HIGHEST = position_limits()
KP = g1.gains(g1.ALL_JOINTS)[0]


def beyond(limit):
    return float(np.nextafter(limit, np.inf))


@pytest.mark.parametrize(
    ("row", "limit", "at", "after"),
    [
        (faults.state_age, 0.020, NONE, WARN),
        (faults.state_age, 0.050, WARN, DAMPING),
        (faults.target_age, 0.040, NONE, WARN),
        (faults.target_age, 0.080, WARN, DAMPING),
        (faults.lasting, 1.0, WARN, LOWER),
        (faults.box_unseen, 2.0, NONE, HOLD),
        (faults.pose_age, 1.0, NONE, HOLD),
        (faults.gamepad, 3.0, NONE, HOLD),
    ],
)
def test_times(row, limit, at, after):
    assert row(limit, LIMITS) is at and row(beyond(limit), LIMITS) is after
    assert row(np.nan, LIMITS) == row(np.inf, LIMITS) >= after


@pytest.mark.parametrize(("row", "most"), [(faults.states_refused, 5), (faults.targets_refused, 3)])
def test_in_a_row(row, most):
    assert [row(n, LIMITS) for n in (0, 1, most - 1, most)] == [NONE, WARN, WARN, DAMPING]


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("axis", [1, 2])
def test_lean(axis, sign):
    def attitude(angle, length=1.0):
        quaternion = np.zeros(4)
        quaternion[0], quaternion[axis] = np.cos(angle / 2), np.sin(angle / 2)
        return sign * length * quaternion

    for length in (0.9, 1.0, 1.1):
        assert faults.lean(attitude(1.0 - 1e-6, length), LIMITS) is NONE
        assert faults.lean(attitude(1.0 + 1e-6, length), LIMITS) is DAMPING
        assert faults.lean(attitude(-1.0 - 1e-6, length), LIMITS) is DAMPING
        assert faults.lean(attitude(np.pi, length), LIMITS) is DAMPING


def test_a_turn_is_no_lean():
    assert faults.lean(np.array([np.cos(1.0), 0.0, 0.0, np.sin(1.0)]), LIMITS) is NONE


def test_no_attitude_is_a_fall():
    with np.errstate(invalid="ignore"):
        assert faults.lean(np.zeros(4), LIMITS) is DAMPING
        assert faults.lean(np.full(4, np.nan), LIMITS) is DAMPING


@pytest.mark.parametrize(
    ("row", "limit", "size"), [(faults.joint_speed, 30.0, 29), (faults.gyro, 6.0, 3)], ids=["joint", "gyro"]
)
def test_speeds(row, limit, size):
    for i in range(size):
        values = np.zeros(size)
        for sign in (-1.0, 1.0):
            values[i] = sign * limit
            assert row(values, LIMITS) is NONE
            values[i] = sign * beyond(limit)
            assert row(values, LIMITS) is DAMPING
        values[i] = np.nan
        assert row(values, LIMITS) is DAMPING


def test_heat():
    temperatures = np.tile(np.int16([80, 110]), (29, 1))
    assert not faults.hot(temperatures, LIMITS)
    for place in np.ndindex(29, 2):
        hot = temperatures.copy()
        hot[place] += 1
        assert faults.hot(hot, LIMITS)


def test_charge():
    assert not faults.empty(15.0, LIMITS) and faults.empty(14.9, LIMITS) and not faults.empty(None, LIMITS)


def test_an_encoder_that_slips():
    q = np.zeros(29)
    for passed_s, most in ((0.0, 0.1), (0.002, 0.16), (0.02, 0.7)):
        assert not jumped(q + most, q, passed_s, LIMITS).any()
        slipped = q.copy()
        slipped[7] = -beyond(most + 1e-12)
        assert jumped(slipped, q, passed_s, LIMITS).nonzero()[0].tolist() == [7]
    assert jumped(np.full(29, np.nan), q, 1.0, LIMITS).all()


def targets(**fields):
    record = np.zeros((), TARGETS)
    record["stamp_s"], record["q"] = 1.0, np.clip(0.0, LOWEST, HIGHEST)
    for name, value in fields.items():
        record[name] = value
    return record


def why(new, before=None, q=None, now_s=1.0):
    return refusal(new, before, new["q"] if q is None else q, now_s, LIMITS)


def test_good_targets():
    assert why(targets()) == "" and why(targets(), targets(stamp_s=0.98)) == ""


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("name", ["q", "tau"])
def test_targets_that_are_not_finite(name, value):
    new = targets()
    new[name][4] = value
    assert why(new, q=np.zeros(29)) == "a number of left_ankle_pitch_joint is not finite"


@pytest.mark.parametrize("value", [1e30, -1e30, 1e308])
def test_huge_targets(value):
    for name in ("q", "tau"):
        new = targets()
        new[name][22] = value
        with np.errstate(over="ignore"):
            assert "right_shoulder_pitch_joint" in why(new, q=np.zeros(29))


def test_range_of_targets():
    for i in range(29):
        for end, sign in ((LOWEST, -1.0), (HIGHEST, 1.0)):
            new = targets()
            new["q"][i] = np.float32(end[i]) + sign * (1.2 - 1e-6)
            assert "beyond its range" not in why(new)
            new["q"][i] = np.float32(end[i]) + sign * (1.2 + 1e-6)
            assert why(new).startswith(f"{g1.ALL_JOINTS[i]} is 1.2 rad beyond its range")


def test_step_of_targets():
    before = targets(stamp_s=0.98)
    for i in range(29):
        new = targets()
        new["q"][i] += 0.7 - 1e-9
        assert why(new, before) == ""
        new["q"][i] += 2e-9
        assert why(new, before) == f"{g1.ALL_JOINTS[i]} steps by 0.7 rad: 0.7 are allowed"
    assert why(new, targets(stamp_s=0.96)) == ""


def test_torque_of_targets():
    for i in range(29):
        most = 1.6 * torque_limits()[i]
        measured = targets()["q"].copy()
        measured[i] -= (most - 1e-3) / KP[i]
        assert why(targets(), q=measured) == ""
        measured[i] -= 2e-3 / KP[i]
        assert refusal(targets(), None, None, 1.0, LIMITS) == ""
        assert f"{g1.ALL_JOINTS[i]} is asked for 1.6 of its torque" in why(targets(), q=measured)


def test_a_joint_that_its_load_pushed_away_is_not_the_new_targets_fault():
    """A wrist is told to stay where it is; the box bends it by more than its motor can hold."""
    i = g1.ALL_JOINTS.index("right_wrist_yaw_joint")
    measured = targets()["q"].copy()
    measured[i] -= 1.9 * torque_limits()[i] / KP[i]
    before = targets(stamp_s=0.98)
    assert "is asked for 1.9 of its torque" in why(targets(), q=measured)
    assert why(targets(), before, measured) == ""
    less, more = targets(), targets()
    less["q"][i], more["q"][i] = less["q"][i] - 0.01, more["q"][i] + 0.01
    assert why(less, before, measured) == ""
    assert "right_wrist_yaw_joint is asked for" in why(more, before, measured)


def test_stamps_and_ages_of_targets():
    assert "in the future" in why(targets(stamp_s=1.0051)) and why(targets(stamp_s=1.0049)) == ""
    assert "age of box or pose" in why(targets(box_age_s=np.nan)) and "age" in why(targets(pose_age_s=-0.1))
    assert why(targets(box_age_s=np.inf)) == ""


def test_limits_in_the_wrong_order():
    with pytest.raises(InvalidConfig, match="state_warn_s of at most state_s"):
        GuardLimits(state_warn_s=0.06)
    with pytest.raises(InvalidConfig, match="target_posture_s of at most target_s"):
        GuardLimits(target_posture_s=0.2)
    with pytest.raises(InvalidConfig, match="lean_rad"):
        GuardLimits(lean_rad=np.nan)
    for name in ("lean_rad", "falling_rad"):
        with pytest.raises(InvalidConfig, match=name):
            GuardLimits(**{name: 60.0})
