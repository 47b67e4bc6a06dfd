"""The step from average to average, against torch's and one that is written out."""

import pytest
import torch

from hotice.errors import InvalidConfig
from hotice.learn.branches.config import BranchConfig
from hotice.learn.branches.outer import OuterStep


def walk(step, means, start):
    """Averages after each round, whose branches' mean is `means[r]` beside where it began."""
    now, velocity, seen = {"w": start}, {}, []
    for offset in means:
        now, velocity = step(now, {"w": now["w"] + offset}, velocity)
        seen.append(now["w"])
    return seen


@pytest.fixture
def offsets():
    generator = torch.Generator().manual_seed(0)
    return [torch.randn(5, generator=generator) for _ in range(4)]


def test_a_plain_step_is_the_mean_to_the_last_bit(offsets):
    mean = {"w": offsets[0], "v": offsets[1]}
    after, velocity = OuterStep()({"w": offsets[2], "v": offsets[3]}, mean, {})
    assert velocity == {} and all(torch.equal(after[name], mean[name]) for name in mean)


@pytest.mark.parametrize("rate, momentum", [(0.7, 0.9), (1.0, 0.5), (0.5, 0.0), (1.0, 0.0)])
def test_it_is_nesterov_s_step_of_torch(offsets, rate, momentum):
    start = torch.linspace(-1, 1, 5)
    seen = walk(OuterStep(learning_rate=rate, momentum=momentum), offsets, start)
    weight = torch.nn.Parameter(start.double())
    optimizer = torch.optim.SGD([weight], lr=rate, momentum=momentum, nesterov=momentum > 0)
    for offset, ours in zip(offsets, seen, strict=True):
        weight.grad = -offset.double()
        optimizer.step()
        torch.testing.assert_close(ours.double(), weight.detach(), rtol=0, atol=1e-6)


def test_two_rounds_by_hand():
    """α = 0.5, μ = 0.8; the branches' mean is 1 beyond the last average, then 2."""
    first, second = walk(
        OuterStep(learning_rate=0.5, momentum=0.8), [torch.tensor([1.0]), torch.tensor([2.0])], torch.zeros(1)
    )
    assert first.item() == pytest.approx(0.5 * (1 + 0.8 * 1))
    assert second.item() == pytest.approx(0.9 + 0.5 * (2 + 0.8 * (0.8 * 1 + 2)))


def test_weights_stay_of_their_kind(offsets):
    after, velocity = OuterStep(momentum=0.9)({"w": offsets[0]}, {"w": offsets[1]}, {})
    assert after["w"].dtype == velocity["w"].dtype == torch.float32


@pytest.mark.parametrize(
    "given, said",
    [
        (dict(branches=0), "branches is 0"),
        (dict(branches=2000), "branches is 2000"),
        (dict(merge_every=0), "merge_every is 0"),
        (dict(outer_momentum=1.0), "outer_momentum is 1.0"),
        (dict(outer_learning_rate=0.0), "outer_learning_rate is 0.0"),
    ],
)
def test_numbers_that_cannot_be_are_refused(given, said):
    with pytest.raises(InvalidConfig, match=said):
        BranchConfig(**given)


def test_a_round_has_whole_updates():
    assert [BranchConfig(merge_every=n).updates(64) for n in (1, 64, 65, 640)] == [1, 1, 2, 10]


def test_one_branch_that_is_its_own_average_is_none():
    assert not BranchConfig().several and not BranchConfig(merge_every=5).several
    assert BranchConfig(branches=2).several and BranchConfig(outer_momentum=0.5).several
