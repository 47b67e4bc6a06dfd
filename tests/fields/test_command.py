"""The navigation command: closed forms, and one robot in NumPy against a batch in torch."""

import math

import numpy as np
import pytest
import torch

from hotice.fields.command import heading_error, navigation_command

ETA, SPEED, GAIN = 0.6, 0.6, 2.0


def random_case(count=200, near=False):
    g = torch.Generator().manual_seed(0)
    reach = 0.2 if near else 3.0
    return 3.0 * torch.randn(count, 4, 3, generator=g), reach * torch.randn(count, 2, generator=g)


def test_horizontal_length_is_the_speed():
    force, offset = random_case()
    c, speed = navigation_command(force, offset, ETA, SPEED, GAIN)
    torch.testing.assert_close(c[:, :2].norm(dim=1), speed)
    torch.testing.assert_close(speed, torch.clamp(GAIN * offset.norm(dim=1), max=SPEED))


def test_far_away_the_direction_is_the_mean_of_the_fields():
    direction = torch.tensor([0.8, -0.6, 0.0])
    force = (0.6 * direction).expand(1, 4, 3)
    c, _ = navigation_command(force, torch.tensor([[-2.0, 0.0]]), ETA, SPEED, GAIN)
    torch.testing.assert_close(c[0], SPEED * direction)


@pytest.mark.parametrize("eta", [0.6, 1.0])
def test_one_strong_vector_does_not_drown_the_others(eta):
    force = torch.tensor([[[eta, 0.0, 0.0]] * 3 + [[0.0, 900.0, 0.0]]])
    c, _ = navigation_command(force, torch.tensor([[2.0, 0.0]]), eta, SPEED, GAIN)
    assert math.degrees(math.atan2(c[0, 1], c[0, 0])) == pytest.approx(math.degrees(math.atan2(1, 3)), abs=1e-3)


@pytest.mark.parametrize("eta", [0.3, 0.6, 1.0])
def test_the_vertical_part_is_the_mean_of_vectors_cut_at_eta(eta):
    force = np.array([[eta, 0.0, 0.0], [0.6 * eta, 0.0, 0.8 * eta], [0.0, 0.0, 7.0], [0.1 * eta, 0.0, 0.0]])
    c, speed = navigation_command(force, np.array([2.0, 0.0]), eta, SPEED, GAIN)
    np.testing.assert_allclose(c, [SPEED, 0.0, 1.8 * eta / 4], atol=1e-12)
    assert speed == SPEED


def test_slows_to_rest_on_the_goal_and_points_at_it():
    # the fields disagree close by
    away = torch.tensor([[-0.6, 0.0, 0.0]]).expand(5, 4, 3)
    offset = torch.tensor([[0.2, 0.1], [0.1, 0.05], [0.02, 0.01], [0.0, 1e-4], [0.0, 0.0]])
    c, speed = navigation_command(away, offset, ETA, SPEED, GAIN)
    assert (speed[:-1] > speed[1:]).all() and speed[-1] == 0 and c[-1].abs().max() == 0
    torch.testing.assert_close(c[3, :2], 2e-4 * torch.tensor([0.0, 1.0]), atol=2e-6, rtol=0)
    assert torch.isfinite(navigation_command(torch.zeros(1, 4, 3), torch.zeros(1, 2), ETA, SPEED, GAIN)[0]).all()


@pytest.mark.parametrize(("eta", "speed_m_s", "gain_hz"), [(0.6, 0.7, 3.0), (1.0, 0.5, 2.0)])
@pytest.mark.parametrize("near", [False, True])
def test_one_robot_in_numpy_is_a_row_of_a_batch_in_torch(eta, speed_m_s, gain_hz, near):
    force, offset = (t.double() for t in random_case(50, near))
    yaw = torch.linspace(-3.0, 3.0, 50, dtype=torch.float64)
    c, speed = navigation_command(force, offset, eta, speed_m_s, gain_hz)
    error = heading_error(c, speed, yaw, speed_m_s)
    assert isinstance(c, torch.Tensor) and c.dtype == torch.float64 and error.abs().max() > 1.0
    for i in range(50):
        alone, its = navigation_command(force[i].numpy(), offset[i].numpy(), eta, speed_m_s, gain_hz)
        assert isinstance(alone, np.ndarray) and alone.shape == (3,)
        np.testing.assert_allclose(alone, c[i], atol=1e-12)
        np.testing.assert_allclose(its, speed[i], atol=1e-12)
        np.testing.assert_allclose(heading_error(alone, its, float(yaw[i]), speed_m_s), error[i], atol=1e-12)
    np.testing.assert_allclose(navigation_command(force.numpy(), offset.numpy(), eta, speed_m_s, gain_hz)[0], c)


@pytest.mark.parametrize("yaw, expected", [(0.0, 0.5), (0.5, 0.0), (1.0, -0.5), (0.5 - math.pi + 0.1, math.pi - 0.1)])
def test_heading_error_is_from_heading_to_command(yaw, expected):
    c = SPEED * torch.tensor([[math.cos(0.5), math.sin(0.5), 0.0]])
    error = heading_error(c, torch.tensor([SPEED]), torch.tensor([yaw]), SPEED)
    assert float(error) == pytest.approx(expected, abs=1e-5)


def test_no_turning_at_the_goal():
    c = torch.tensor([[0.0, 0.01, 0.0]])
    assert float(heading_error(c, torch.tensor([0.01]), torch.tensor([0.0]), SPEED)) == 0.0
