import torch

from hotice.learn.ppo.gae import gae

GAMMA, LAM = 0.9, 0.8


def column(*values):
    return torch.tensor(values)[:, None, None]


def flags(*values):
    return torch.tensor(values, dtype=torch.bool)[:, None]


def test_by_hand_without_an_end():
    result = gae(
        column(1.0, 2.0),
        column(0.5, 1.5),
        torch.tensor([[3.0]]),
        column(9.0, 9.0),
        flags(0, 0),
        flags(0, 0),
        GAMMA,
        LAM,
    )
    last = 2.0 + 0.9 * 3.0 - 1.5  # 3.2
    first = 1.0 + 0.9 * 1.5 - 0.5 + 0.72 * last
    torch.testing.assert_close(result, column(first, last))


def test_termination_stops_everything():
    result = gae(
        column(1.0, 2.0),
        column(0.5, 1.5),
        torch.tensor([[3.0]]),
        column(9.0, 9.0),
        flags(1, 0),
        flags(0, 0),
        GAMMA,
        LAM,
    )
    torch.testing.assert_close(result, column(1.0 - 0.5, 3.2))


def test_time_out_uses_the_value_of_the_last_observation():
    result = gae(
        column(1.0, 2.0),
        column(0.5, 1.5),
        torch.tensor([[3.0]]),
        column(4.0, 9.0),
        flags(0, 0),
        flags(1, 0),
        GAMMA,
        LAM,
    )
    torch.testing.assert_close(result, column(1.0 + 0.9 * 4.0 - 0.5, 3.2))


def test_ends_in_the_last_step():
    last = torch.tensor([[3.0]])
    ended = gae(column(2.0), column(1.5), last, column(7.0), flags(1), flags(0), GAMMA, LAM)
    late = gae(column(2.0), column(1.5), last, column(7.0), flags(0), flags(1), GAMMA, LAM)
    torch.testing.assert_close(ended, column(0.5))
    torch.testing.assert_close(late, column(2.0 + 0.9 * 7.0 - 1.5))


def test_streams_and_environments_do_not_mix():
    g = torch.Generator().manual_seed(0)

    def draw(*shape):
        return torch.randn(*shape, generator=g)

    reward, value, last, final = draw(6, 3, 2), draw(6, 3, 2), draw(3, 2), draw(6, 3, 2)
    terminated, truncated = torch.rand(6, 3, generator=g) < 0.3, torch.rand(6, 3, generator=g) < 0.3
    whole = gae(reward, value, last, final, terminated, truncated, GAMMA, LAM)
    for n in range(3):
        for a in range(2):
            i, j = slice(n, n + 1), slice(a, a + 1)
            part = gae(
                reward[:, i, j],
                value[:, i, j],
                last[i, j],
                final[:, i, j],
                terminated[:, i],
                truncated[:, i],
                GAMMA,
                LAM,
            )
            torch.testing.assert_close(part, whole[:, i, j])


def test_with_lambda_one_it_is_the_discounted_return_less_the_value():
    g = torch.Generator().manual_seed(1)
    reward, value = torch.randn(5, 1, 1, generator=g), torch.randn(5, 1, 1, generator=g)
    last = torch.randn(1, 1, generator=g)
    no = torch.zeros(5, 1, dtype=torch.bool)
    result = gae(reward, value, last, value, no, no, GAMMA, 1.0)
    returns = sum(GAMMA**t * reward[t] for t in range(5)) + GAMMA**5 * last
    torch.testing.assert_close(result[0], returns - value[0])
