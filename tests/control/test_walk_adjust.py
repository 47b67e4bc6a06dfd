import numpy as np
import pytest
from scipy.optimize import minimize

from hotice.control.walk.adjust import AdjustConfig, StepAdjuster
from hotice.errors import InvalidConfig

OMEGA, LEFT = 3.8, 1.0
STANCE, FOOTHOLD, OFFSET = np.array([0.1, -0.1]), np.array([0.3, 0.14]), np.array([0.07, 0.03])


def dcm_of_the_plan(remaining_s: float) -> np.ndarray:
    """The DCM now that arrives at foothold + offset when the zero-moment point stays in the stance foot."""
    return STANCE + (FOOTHOLD + OFFSET - STANCE) * np.exp(-OMEGA * remaining_s)


def test_a_dcm_on_its_plan_changes_nothing():
    for remaining_s in (0.4, 0.2, 0.05):
        found = StepAdjuster().solve(
            dcm_of_the_plan(remaining_s), STANCE, 0.0, FOOTHOLD, OFFSET, remaining_s, OMEGA, LEFT
        )
        assert found.solved
        assert found.foothold == pytest.approx(FOOTHOLD, abs=1e-4)
        assert found.zmp == pytest.approx(STANCE, abs=1e-4)
        assert found.remaining_s == pytest.approx(remaining_s, abs=1e-3)


def test_plan_is_kept_in_a_turned_frame():
    yaw, R = 0.7, np.array([[np.cos(0.7), -np.sin(0.7)], [np.sin(0.7), np.cos(0.7)]])
    found = StepAdjuster().solve(R @ dcm_of_the_plan(0.3), R @ STANCE, yaw, R @ FOOTHOLD, R @ OFFSET, 0.3, OMEGA, LEFT)
    assert found.foothold == pytest.approx(R @ FOOTHOLD, abs=1e-4)


@pytest.mark.parametrize("push", [(0.06, 0.0), (-0.06, 0.0), (0.0, 0.04), (0.05, 0.03)])
def test_the_landing_follows_a_push(push):
    """The foothold moves in the direction of the push, and zmp, foothold and offset satisfy the DCM dynamics."""
    remaining_s = 0.3
    dcm = dcm_of_the_plan(remaining_s) + push
    found = StepAdjuster().solve(dcm, STANCE, 0.0, FOOTHOLD, OFFSET, remaining_s, OMEGA, LEFT, shift_s=(0.0, 0.0))
    assert (found.foothold - FOOTHOLD) @ np.array(push) > 0.0
    delta, tau = found.zmp - STANCE, np.exp(OMEGA * remaining_s)
    landing = STANCE + delta + (dcm - STANCE - delta) * tau
    assert landing == pytest.approx(found.foothold + found.offset, abs=1e-3)


def test_bounds_hold_for_large_pushes():
    config = AdjustConfig()
    rng = np.random.default_rng(0)
    adjuster = StepAdjuster(config)
    for _ in range(100):
        dcm = dcm_of_the_plan(0.25) + rng.normal(0.0, 0.2, 2)
        found = adjuster.solve(dcm, STANCE, 0.0, FOOTHOLD, OFFSET, 0.25, OMEGA, LEFT, shift_s=(-0.1, 0.1))
        step, zmp = found.foothold - STANCE, np.abs(found.zmp - STANCE)
        assert config.forward_m[0] - 1e-6 <= step[0] <= config.forward_m[1] + 1e-6
        assert config.sideways_m[0] - 1e-6 <= step[1] <= config.sideways_m[1] + 1e-6
        assert (zmp <= np.array(config.zmp_reach_m) + 1e-6).all()
        assert 0.15 - 1e-3 <= found.remaining_s <= 0.35 + 1e-3
        assert found.solved


def test_agrees_with_a_general_solver():
    remaining_s, config = 0.3, AdjustConfig()
    dcm, tau = dcm_of_the_plan(0.3) + [0.05, -0.03], np.exp(OMEGA * 0.3)
    xi, p0 = dcm - STANCE, FOOTHOLD - STANCE

    def cost(y):
        b = xi * tau * y[4] + y[2:4] * (1 - tau) - y[:2]
        return (
            config.foothold_weight * ((y[:2] - p0) ** 2).sum()
            + config.offset_weight * ((b - OFFSET) ** 2).sum()
            + config.zmp_weight * (y[2:4] ** 2).sum()
            + config.timing_weight * (y[4] - 1) ** 2
        )

    bounds = [
        config.forward_m,
        config.sideways_m,
        *[(-r, r) for r in config.zmp_reach_m],
        (np.exp(-0.1 * OMEGA), np.exp(0.1 * OMEGA)),
    ]
    best = minimize(
        cost, [*p0, 0.0, 0.0, 1.0], bounds=bounds, method="L-BFGS-B", options={"ftol": 1e-15, "gtol": 1e-10}
    )
    found = StepAdjuster(config).solve(dcm, STANCE, 0.0, FOOTHOLD, OFFSET, remaining_s, OMEGA, LEFT)
    assert found.foothold - STANCE == pytest.approx(best.x[:2], abs=1e-4)
    assert found.zmp - STANCE == pytest.approx(best.x[2:4], abs=1e-4)


def test_a_frozen_step_keeps_foothold_and_time():
    dcm = dcm_of_the_plan(0.05) + [0.1, 0.1]
    found = StepAdjuster().solve(dcm, STANCE, 0.0, FOOTHOLD, OFFSET, 0.05, OMEGA, LEFT, freeze=True)
    assert found.foothold == pytest.approx(FOOTHOLD, abs=1e-9)
    assert found.remaining_s == pytest.approx(0.05, abs=1e-6)


def test_equal_questions_have_equal_answers():
    adjuster = StepAdjuster()
    ask = lambda: adjuster.solve(dcm_of_the_plan(0.2) + 0.02, STANCE, 0.0, FOOTHOLD, OFFSET, 0.2, OMEGA, LEFT)  # noqa: E731
    first = ask()
    adjuster.solve(dcm_of_the_plan(0.3) - 0.1, STANCE, 0.5, FOOTHOLD, OFFSET, 0.3, OMEGA, LEFT)
    again = ask()
    assert (first.foothold == again.foothold).all() and (first.zmp == again.zmp).all()


def test_bad_numbers_are_refused():
    with pytest.raises(InvalidConfig, match="offset_weight"):
        AdjustConfig(offset_weight=0.0)
    with pytest.raises(InvalidConfig, match="the lowest number, then the highest"):
        AdjustConfig(forward_m=(0.3, 0.1))
