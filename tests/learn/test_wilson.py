import pytest

from hotice.learn.wilson import wilson


@pytest.mark.parametrize(
    "successes, trials, low, high",
    [
        (0, 10, 0.0, 0.2775),
        (10, 10, 0.7225, 1.0),
        (5, 10, 0.2366, 0.7634),
        (81, 263, 0.2553, 0.3662),
        (1, 1, 0.2065, 1.0),
    ],
)
def test_known_intervals(successes, trials, low, high):
    """81 of 263 is the example of Newcombe (1998), table I."""
    assert wilson(successes, trials) == pytest.approx((low, high), abs=1e-4)


def test_nothing_is_known_without_trials():
    assert wilson(0, 0) == (0.0, 1.0)
