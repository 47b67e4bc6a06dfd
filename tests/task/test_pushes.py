"""Pushes: how large, where to, and the same in NumPy as in torch."""

import numpy as np
import pytest
import torch

from hotice.model.dynamics import LEAST_PUSH
from hotice.task.pushes import push_velocity


def test_whether_where_to_and_how_much():
    size = 0.5 * (LEAST_PUSH + (1.0 - LEAST_PUSH) * 0.5)
    np.testing.assert_allclose(
        push_velocity(np.float64(0.1), np.float64(0.25), np.float64(0.5), 0.5, 0.2), [0, size], atol=1e-15
    )
    np.testing.assert_allclose(
        push_velocity(np.float64(0.1), np.float64(0.5), np.float64(0.0), 2.0, 0.2), [-0.2, 0], atol=1e-15
    )
    np.testing.assert_array_equal(push_velocity(np.float64(0.2), np.float64(0.5), np.float64(0.5), 0.5, 0.2), [0, 0])


@pytest.mark.parametrize(("size_m_s", "chance"), [(1.0, 0.02 / 7.5), (0.4, 0.5)])
def test_one_robot_in_numpy_is_a_row_of_a_batch_in_torch(size_m_s, chance):
    draws = np.random.default_rng(0).random((2000, 3))
    batch = push_velocity(*torch.from_numpy(draws).unbind(1), size_m_s, chance)
    alone = np.array([push_velocity(*row, size_m_s, chance) for row in draws])
    np.testing.assert_allclose(alone, batch, atol=1e-15)
    pushed = np.linalg.norm(alone, axis=1)[draws[:, 0] < chance]
    assert len(pushed) > 2 and (pushed >= LEAST_PUSH * size_m_s).all() and (pushed <= size_m_s).all()
