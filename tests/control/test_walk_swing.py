import numpy as np
import pytest

from hotice.control.walk.swing import Swing, SwingShape, minimum_jerk


def test_minimum_jerk_meets_both_ends():
    start, speed, accel, end = np.array([0.1]), np.array([0.4]), np.array([-1.0]), np.array([0.7])
    x, v, a = minimum_jerk(0.0, 0.5, start, speed, accel, end)
    assert (x, v, a) == (pytest.approx(start), pytest.approx(speed), pytest.approx(accel))
    x, v, a = minimum_jerk(0.5 - 1e-9, 0.5, start, speed, accel, end)
    assert (x, v, a) == (pytest.approx(end), pytest.approx([0.0], abs=1e-6), pytest.approx([0.0], abs=1e-5))


def test_derivatives_of_minimum_jerk():
    args, h = (np.array([0.1]), np.array([0.4]), np.array([-1.0]), np.array([0.7])), 1e-5
    for t in (0.1, 0.25, 0.4):
        (x0, v0, _), (_, v, a), (x1, v1, _) = (minimum_jerk(s, 0.5, *args) for s in (t - h, t, t + h))
        assert (x1 - x0) / (2 * h) == pytest.approx(v, abs=1e-6)
        assert (v1 - v0) / (2 * h) == pytest.approx(a, abs=1e-5)


@pytest.mark.parametrize("shape", [SwingShape(apex_m=0.06), SwingShape(apex_m=0.15, rise=0.4, leave=0.1, fall=0.6)])
def test_height_rises_to_the_apex_and_lands(shape):
    heights = np.array([shape.height(u)[0] for u in np.linspace(0, 1, 201)])
    assert heights[0] == 0.0 and heights[-1] == pytest.approx(0.0, abs=1e-9)
    assert heights.max() == pytest.approx(shape.apex_m)
    assert (np.diff(heights[: int(200 * shape.rise)]) >= 0).all() and (
        np.diff(heights[int(200 * shape.fall) :]) <= 1e-12
    ).all()


def run(swing: Swing, landing_of, span_s: float = 0.4, dt: float = 0.005):
    poses, speeds = [], []
    for k in range(1, round(span_s / dt) + 1):
        pose, speed, _ = swing.step(k * dt, landing_of(k * dt), 0.2, span_s - k * dt)
        poses.append(pose)
        speeds.append(speed)
    return np.array(poses), np.array(speeds)


def test_swing_arrives_at_the_landing_at_rest():
    landing = np.array([0.5, 0.1, 0.035])
    poses, speeds = run(Swing(np.array([0.1, 0.12, 0.035]), 0.0, SwingShape(), 0.4), lambda t: landing)
    assert poses[-1] == pytest.approx([0.5, 0.1, 0.035, 0.2], abs=1e-6)
    assert speeds[-1] == pytest.approx(np.zeros(4), abs=1e-6)


def test_a_landing_that_moves_is_still_met_without_jumps():
    poses, _ = run(
        Swing(np.array([0.1, 0.12, 0.035]), 0.0, SwingShape(), 0.4),
        lambda t: np.array([0.5 + (0.06 if t > 0.2 else 0.0), 0.1, 0.035]),
    )
    assert poses[-1, :3] == pytest.approx([0.56, 0.1, 0.035], abs=1e-6)
    assert np.abs(np.diff(poses[:, 0])).max() < 0.02
