import math

import pytest
import torch

from hotice.learn.ppo.losses import clipped_surrogate, clipped_value
from hotice.learn.ppo.networks import kl_divergence, log_prob


@pytest.mark.parametrize(
    "ratio, advantage, expected",
    [(1.1, 2.0, -2.2), (1.5, 2.0, -2.4), (0.5, 2.0, -1.0), (0.5, -2.0, 1.6), (1.5, -2.0, 3.0), (1.0, -1.0, 1.0)],
)
def test_clipped_surrogate(ratio, advantage, expected):
    loss = clipped_surrogate(torch.tensor([ratio]), torch.tensor([advantage]), 0.2)
    assert float(loss) == pytest.approx(expected)


def test_no_gradient_once_clipped():
    ratio = torch.tensor([1.5, 0.5], requires_grad=True)
    clipped_surrogate(ratio, torch.tensor([1.0, -1.0]), 0.2).backward()
    assert ratio.grad.tolist() == [0.0, 0.0]


@pytest.mark.parametrize("value, expected", [(1.1, 0.81), (1.5, 0.64), (0.5, 2.25), (2.0, 0.64)])
def test_clipped_value(value, expected):
    """Old value 1, return 2, clip 0.2: an improvement beyond 1.2 does not count, a worsening does."""
    loss = clipped_value(torch.tensor([value]), torch.tensor([1.0]), torch.tensor([2.0]), 0.2)
    assert float(loss) == pytest.approx(expected)


def test_log_prob_and_kl_against_torch():
    g = torch.Generator().manual_seed(0)
    action, mean, other = (torch.randn(7, 4, generator=g) for _ in range(3))
    std, std2 = torch.tensor([0.3, 1.0, 2.0, 0.1]), torch.tensor([0.4, 0.9, 1.0, 0.3])
    p, q = torch.distributions.Normal(mean, std), torch.distributions.Normal(other, std2)
    torch.testing.assert_close(log_prob(action, mean, std), p.log_prob(action).sum(-1))
    torch.testing.assert_close(kl_divergence(mean, std, other, std2), torch.distributions.kl_divergence(p, q).sum(-1))
    assert float(log_prob(torch.zeros(1, 1), torch.zeros(1, 1), torch.ones(1))) == pytest.approx(
        -0.5 * math.log(2 * math.pi)
    )
