import numpy as np
import pytest
from scipy.optimize import least_squares

from hotice.model.least_squares import minimize


def test_linear_problem_in_closed_form():
    rng = np.random.default_rng(0)
    A, b = rng.normal(size=(7, 4)), rng.normal(size=7)
    x = minimize(lambda v: (A @ v - b, A), np.zeros(4), np.full(4, -9.0), np.full(4, 9.0))
    np.testing.assert_allclose(x, np.linalg.lstsq(A, b, rcond=None)[0], atol=1e-9)


@pytest.mark.parametrize("seed", range(10))
def test_bounded_linear_problem_against_scipy(seed):
    rng = np.random.default_rng(seed)
    A, b = rng.normal(size=(8, 5)), 3 * rng.normal(size=8)
    lower, upper = np.full(5, -0.3), np.full(5, 0.4)
    x = minimize(lambda v: (A @ v - b, A), np.full(5, 5.0), lower, upper)
    reference = least_squares(
        lambda v: A @ v - b, np.zeros(5), bounds=(lower, upper), xtol=1e-15, ftol=1e-15, gtol=1e-14
    )
    assert (x >= lower).all() and (x <= upper).all() and (np.isin(x, (-0.3, 0.4))).any()
    np.testing.assert_allclose(((A @ x - b) ** 2).sum(), 2 * reference.cost, rtol=1e-6)


def test_curved_valley():
    """Rosenbrock's function, with and without a bound before its minimum at (1, 1)."""

    def residual(v):
        return np.array([10 * (v[1] - v[0] ** 2), 1 - v[0]]), np.array([[-20 * v[0], 10.0], [-1.0, 0.0]])

    wide = np.full(2, 3.0)
    np.testing.assert_allclose(minimize(residual, [-1.2, 1.0], -wide, wide), [1, 1], atol=1e-6)
    np.testing.assert_allclose(minimize(residual, [-1.2, 1.0], -wide, [0.5, 3]), [0.5, 0.25], atol=1e-6)


def test_ends_without_descent():
    """Flat, cornered and unsolvable problems end."""
    one = np.ones(2)
    assert (minimize(lambda v: (np.zeros(1), np.zeros((1, 2))), one, -one, one) == one).all()
    assert (minimize(lambda v: (v - 5, np.eye(2)), one, -one, one) == one).all()
    x = minimize(lambda v: (np.array([v[0] ** 2 + 1]), np.array([[2 * v[0]]])), [2.0], [-3.0], [3.0])
    assert abs(x[0]) < 0.1
