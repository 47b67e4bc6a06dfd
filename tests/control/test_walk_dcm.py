import numpy as np
import pytest

from hotice.control.walk.dcm import DcmReference, natural_frequency
from hotice.errors import InvalidConfig

OMEGA = natural_frequency(0.66)
TIME = np.array([0.0, 0.45, 0.87, 0.95, 1.37, 1.8])
ZMP = np.array([[0.0, 0.0], [0.0, -0.12], [0.0, -0.12], [0.2, 0.12], [0.2, 0.12], [0.3, 0.0]])


def test_frequency_of_the_pendulum():
    assert natural_frequency(9.81) == pytest.approx(1.0)
    assert natural_frequency(-0.1) == natural_frequency(0.3) == pytest.approx((9.81 / 0.3) ** 0.5)


def test_dcm_obeys_its_dynamics_between_knots():
    reference, h = DcmReference.through(TIME, ZMP, OMEGA), 1e-5
    for t in (0.1, 0.6, 0.9, 1.2, 1.6):
        dcm, velocity, zmp = reference.at(t)
        slope = (reference.at(t + h)[0] - reference.at(t - h)[0]) / (2 * h)
        assert velocity == pytest.approx(OMEGA * (dcm - zmp), abs=1e-12)
        assert slope == pytest.approx(velocity, abs=1e-6)


def test_dcm_is_continuous_and_ends_at_rest():
    reference = DcmReference.through(TIME, ZMP, OMEGA)
    for t in TIME[1:]:
        assert reference.at(t - 1e-9)[0] == pytest.approx(reference.at(t + 1e-9)[0], abs=1e-6)
    dcm, velocity, zmp = reference.at(5.0)
    assert dcm == pytest.approx(ZMP[-1]) and zmp == pytest.approx(ZMP[-1]) and velocity == pytest.approx(np.zeros(2))


def test_constant_zmp_gives_the_exponential():
    reference = DcmReference.through(np.array([0.0, 0.4, 0.5]), np.array([[0.0, 0], [0, 0], [0.1, 0]]), OMEGA)
    start, end = reference.at(0.0)[0], reference.at(0.4)[0]
    assert end == pytest.approx(start * np.exp(OMEGA * 0.4))


def test_pendulum_driven_by_the_reference_comes_to_rest():
    """Integrates x' = omega (xi - x) with the reference: the centre of mass ends where the last support is."""
    reference = DcmReference.through(TIME, ZMP, OMEGA)
    x, dt = reference.at(0.0)[0].copy(), 1e-3
    for k in range(5000):
        x = x + dt * OMEGA * (reference.at(k * dt)[0] - x)
    assert x == pytest.approx(ZMP[-1], abs=1e-4)


def test_bad_knots_are_refused():
    with pytest.raises(InvalidConfig, match="ascending"):
        DcmReference.through(np.array([0.0, 0.0]), np.zeros((2, 2)), OMEGA)
