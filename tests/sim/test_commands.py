import math

import pytest
import torch

from hotice.sim.commands import heading_error, navigation_command

SPEED, GAIN = 0.6, 2.0


def random_case(count=200):
    g = torch.Generator().manual_seed(0)
    return 3.0 * torch.randn(count, 4, 3, generator=g), 3.0 * torch.randn(count, 2, generator=g)


def test_horizontal_length_is_the_speed():
    force, offset = random_case()
    c, speed = navigation_command(force, offset, SPEED, GAIN)
    torch.testing.assert_close(c[:, :2].norm(dim=1), speed)
    torch.testing.assert_close(speed, torch.clamp(GAIN * offset.norm(dim=1), max=SPEED))


def test_far_away_the_direction_is_the_mean_of_the_fields():
    direction = torch.tensor([0.8, -0.6, 0.0])
    force = (0.6 * direction).expand(1, 4, 3)
    c, _ = navigation_command(force, torch.tensor([[-2.0, 0.0]]), SPEED, GAIN)
    torch.testing.assert_close(c[0], SPEED * direction)


def test_one_strong_vector_does_not_drown_the_others():
    force = torch.tensor([[[0.6, 0.0, 0.0]] * 3 + [[0.0, 900.0, 0.0]]])
    c, _ = navigation_command(force, torch.tensor([[2.0, 0.0]]), SPEED, GAIN)
    assert math.degrees(math.atan2(c[0, 1], c[0, 0])) == pytest.approx(math.degrees(math.atan2(1, 3)), abs=1e-3)


def test_slows_to_rest_on_the_goal_and_points_at_it():
    away = torch.tensor([[-0.6, 0.0, 0.0]]).expand(5, 4, 3)  # the fields disagree close by
    offset = torch.tensor([[0.2, 0.1], [0.1, 0.05], [0.02, 0.01], [0.0, 1e-4], [0.0, 0.0]])
    c, speed = navigation_command(away, offset, SPEED, GAIN)
    assert (speed[:-1] > speed[1:]).all() and speed[-1] == 0 and c[-1].abs().max() == 0
    torch.testing.assert_close(c[3, :2], 2e-4 * torch.tensor([0.0, 1.0]), atol=2e-6, rtol=0)
    assert torch.isfinite(navigation_command(torch.zeros(1, 4, 3), torch.zeros(1, 2), SPEED, GAIN)[0]).all()


def test_in_free_space_the_command_follows_the_field_to_the_goal(env):
    """On the open floor c points at the goal, from anywhere."""
    env.memory.scene[:] = env.bank.index("open_floor")
    env.physics.qpos[:, 1] += torch.linspace(-0.4, 0.4, 8, dtype=torch.float64)
    env.physics.forward(torch.arange(8))
    s = env.snapshot()
    cosine = torch.nn.functional.cosine_similarity(s.c_W[:, :2], (env.bank.goal_W[0] - s.p_WP)[:, :2])
    assert (cosine > 0.99).all()


@pytest.mark.parametrize("yaw, expected", [(0.0, 0.5), (0.5, 0.0), (1.0, -0.5), (0.5 - math.pi + 0.1, math.pi - 0.1)])
def test_heading_error_is_from_heading_to_command(yaw, expected):
    c = SPEED * torch.tensor([[math.cos(0.5), math.sin(0.5), 0.0]])
    error = heading_error(c, torch.tensor([SPEED]), torch.tensor([yaw]), SPEED)
    assert float(error) == pytest.approx(expected, abs=1e-5)


def test_no_turning_at_the_goal():
    c = torch.tensor([[0.0, 0.01, 0.0]])
    assert float(heading_error(c, torch.tensor([0.01]), torch.tensor([0.0]), SPEED)) == 0.0
