"""Steps with an object in the hands: the course keeps its weight on standing feet and ends where it was asked to."""

import numpy as np
import pytest

pytest.importorskip("pinocchio")

from hotice.control.pickup.footwork import GRID_S, LANDING_S, SWING_S, Departure, Goal, plan_approach, plan_steps
from hotice.control.pickup.stepping import moved
from hotice.errors import InvalidConfig
from hotice.model.frames import quat_from_yaw, quat_rotate, yaw_from_quat

FEET = np.array([[0.0, 0.12, 0.035, 0.0], [0.0, -0.12, 0.035, 0.0]])
COM, HEIGHT_M = np.array([0.03, 0.0]), 0.7


def turned(yaw, feet=FEET):
    """The same feet, facing elsewhere."""
    c, s = np.cos(yaw), np.sin(yaw)
    out = feet.copy()
    out[:, :2] = feet[:, :2] @ np.array([[c, s], [-s, c]])
    out[:, 3] += yaw
    return out


@pytest.mark.parametrize("back, turn", [(0.4, 0.0), (0.4, 1.1), (0.0, -0.9), (0.1, 3.0)])
def test_the_zero_moment_point_stays_under_the_standing_foot(back, turn):
    course = plan_steps(FEET, COM, HEIGHT_M, Departure(back_m=back, turn_rad=turn))
    acceleration = np.gradient(np.gradient(course.com, GRID_S, axis=0), GRID_S, axis=0)
    np.testing.assert_allclose(acceleration[2:-2], course.com_acc[2:-2], atol=0.06)
    zmp, swung = course.com - HEIGHT_M / 9.81 * course.com_acc, 0
    for i in range(0, len(zmp), 5):
        feet = course.feet_at(i * GRID_S)
        assert feet.air != feet.landed or feet.air == -1
        if feet.air >= 0:
            swung += 1
            x, y, _, yaw = feet.pose[1 - feet.air]
            off = zmp[i] - [x, y]
            ahead, aside = np.cos(yaw) * off[0] + np.sin(yaw) * off[1], np.cos(yaw) * off[1] - np.sin(yaw) * off[0]
            assert -0.05 < ahead < 0.12 and abs(aside) < 0.03
    assert swung > 0 and LANDING_S < SWING_S


@pytest.mark.parametrize("yaw", [0.0, 2.0])
def test_it_ends_where_it_was_asked_to(yaw):
    start, ahead = turned(yaw), np.array([np.cos(yaw), np.sin(yaw)])
    com = COM[0] * ahead
    course = plan_steps(start, com, HEIGHT_M, Departure(back_m=0.4, turn_rad=1.0))
    end, body = course.feet_at(course.seconds), course.body_at(course.seconds)
    middle = start[:, :2].mean(axis=0) + 0.035 * ahead
    sole = end.pose[:, :2].mean(axis=0) + 0.035 * np.array([np.cos(yaw + 1.0), np.sin(yaw + 1.0)])
    np.testing.assert_allclose(sole, middle - 0.4 * ahead, atol=1e-9)
    np.testing.assert_allclose(end.pose[:, 3], yaw + 1.0)
    np.testing.assert_allclose(np.linalg.norm(end.pose[0, :2] - end.pose[1, :2]), 0.24)
    assert body.turn_rad == pytest.approx(1.0) and end.air == -1
    np.testing.assert_allclose(np.linalg.norm(course.com[-1] - sole), np.linalg.norm(com - middle), atol=1e-6)
    first = course.body_at(0.0)
    np.testing.assert_allclose(first.shift, 0.0, atol=1e-9)
    assert first.turn_rad == 0.0


def test_feet_move_as_fast_as_they_say():
    course, h = plan_steps(FEET, COM, HEIGHT_M, Departure(back_m=0.2, turn_rad=0.5)), 1e-5
    for t in np.arange(0.85, course.seconds - 0.1, 0.083):
        a, b = course.feet_at(t - h), course.feet_at(t + h)
        if a.air == b.air:
            np.testing.assert_allclose((b.pose - a.pose) / (2 * h), course.feet_at(t).velocity, atol=1e-3)


def test_steps_are_small_and_the_load_clears_the_support_before_it_turns():
    assert Departure().stances() == []
    for departure in (Departure(back_m=0.4, turn_rad=1.0), Departure(back_m=0.4), Departure(turn_rad=-2.0)):
        back, turn = np.array([(0.0, 0.0), *departure.stances()]).T
        assert np.diff(back).max(initial=0) <= 0.15 + 1e-9 and np.abs(np.diff(turn)).max(initial=0) <= 0.35 + 1e-9
        assert (back[-1], turn[-1]) == pytest.approx((departure.back_m, departure.turn_rad))
    back, turn = np.array(Departure(back_m=0.4, turn_rad=1.0).stances()).T
    assert turn[0] == 0.0 and back[0] > 0.1


def test_a_configuration_moves_as_one_piece():
    q = np.concatenate([[0.1, 0.2, 0.74], np.roll(quat_from_yaw(0.3), -1), np.arange(20.0)])
    com = np.array([0.15, 0.2])
    out = moved(q, com, np.array([-0.3, 0.1]), 0.5)
    arm = quat_rotate(quat_from_yaw(0.5), np.array([*(q[:2] - com), 0.0]))
    np.testing.assert_allclose(out[:2], com + [-0.3, 0.1] + arm[:2])
    assert out[2] == 0.74 and yaw_from_quat(np.roll(out[3:7], 1)) == pytest.approx(0.8)
    np.testing.assert_array_equal(out[7:], q[7:])


@pytest.mark.parametrize("values", [{"back_m": -0.1}, {"back_m": 5.0}, {"turn_rad": float("nan")}, {"turn_rad": 4.0}])
def test_impossible_departures(values):
    with pytest.raises(InvalidConfig, match=next(iter(values))):
        Departure(**values)


@pytest.mark.parametrize("place", [(0.1, 0.05, 0.1), (-0.3, 0.1, -0.6), (0.0, 0.0, 0.0)])
def test_an_approach_ends_where_it_was_asked_to(place):
    """Feet that stand anyhow come to stand square there, in small steps, the weight on standing feet."""
    x, y, yaw = place
    ends, com = turned(yaw), np.array([0.02, 0.01]) + [x, y]
    ends[:, :2] += [x, y]
    start = FEET + np.array([[0.05, 0.0, 0.0, 0.1], [-0.04, -0.02, 0.0, -0.05]])
    course = plan_approach(start, COM, HEIGHT_M, Goal(feet=ends, com=com, turn_rad=yaw))
    np.testing.assert_allclose(course.feet_at(course.seconds).pose, ends, atol=1e-9)
    np.testing.assert_allclose(course.com[-1], com, atol=1e-6)
    assert course.body_at(course.seconds).turn_rad == pytest.approx(yaw)
    zmp = course.com - HEIGHT_M / 9.81 * course.com_acc
    for i in range(0, len(zmp), 5):
        feet = course.feet_at(i * GRID_S)
        if feet.air >= 0:
            assert np.linalg.norm(zmp[i] - feet.pose[1 - feet.air, :2]) < 0.12
    for swing in course.swings:
        assert np.linalg.norm(swing.end[:2] - swing.start[:2]) < 0.45 and abs(swing.end[3] - swing.start[3]) < 0.7
