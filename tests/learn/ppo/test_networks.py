import torch

from hotice.learn.ppo.networks import ActorCritic, Normalizer
from hotice.sim.observations import POLICY, ObservationTable
from hotice.task.presets import DUAL, SINGLE


def net(agents=DUAL, obs=11, critic=13):
    torch.manual_seed(0)
    return ActorCritic(agents, obs, critic, (16, 8), (16,), (0.6, 0.3))


def test_normalizer_equals_the_statistics_of_all_batches():
    g = torch.Generator().manual_seed(0)
    batches = [3.0 + 2.0 * torch.randn(n, 5, generator=g) for n in (10, 1, 300, 7)]
    norm = Normalizer(5)
    for batch in batches:
        norm.update(batch)
    x = torch.cat(batches)
    torch.testing.assert_close(norm.mean, x.mean(0), rtol=1e-4, atol=1e-4)
    torch.testing.assert_close(norm.var, x.var(0, unbiased=False), rtol=1e-4, atol=1e-4)
    z = norm(x)
    assert z.mean(0).abs().max() < 1e-3 and (z.std(0) - 1).abs().max() < 1e-2
    assert float(norm(torch.full((1, 5), 1e6)).max()) == norm.limit


def test_normalizing_commutes_with_mirroring_when_fed_both():
    table, g = ObservationTable(POLICY), torch.Generator().manual_seed(0)
    norm = Normalizer(table.size)
    for _ in range(3):
        x = torch.randn(20, table.size, generator=g) * torch.rand(table.size, generator=g) + 1.0
        norm.update(torch.cat([x, table.mirror(x)]))
    x = torch.randn(50, table.size, generator=g)
    torch.testing.assert_close(norm(table.mirror(x)), table.mirror(norm(x)), atol=1e-5, rtol=1e-5)
    lopsided = Normalizer(table.size)
    lopsided.update(1.0 + x)
    assert (lopsided(table.mirror(x)) - table.mirror(lopsided(x))).abs().max() > 0.1


def test_actions_are_low_then_up():
    n = net()
    obs = torch.randn(3, 11)
    mean = n.mean(obs)
    assert mean.shape == (3, 20) and n.values(torch.randn(3, 13)).shape == (3, 2)
    torch.testing.assert_close(mean[:, :12], n.nets["low"].actor(obs))
    torch.testing.assert_close(mean[:, 12:], n.nets["up"].actor(obs))
    torch.testing.assert_close(n.std(), torch.tensor([0.6] * 12 + [0.3] * 8))


def test_single_agent_has_one_network_for_all_joints():
    n = net(SINGLE)
    assert list(n.nets) == ["whole"] and n.mean(torch.randn(3, 11)).shape == (3, 20)
    assert n.values(torch.randn(3, 13)).shape == (3, 1)
    torch.testing.assert_close(n.std(), torch.tensor([0.6] * 12 + [0.3] * 8))


def test_act_normalizes():
    n = net()
    n.obs_norm.update(5.0 + torch.randn(100, 11))
    raw = torch.randn(4, 11)
    torch.testing.assert_close(n(raw), n.mean(n.obs_norm(raw)))
    assert not torch.allclose(n(raw), n.mean(raw))
