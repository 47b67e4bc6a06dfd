import dataclasses

import pytest
import torch

from hotice.errors import DivergedError
from hotice.learn.ppo.config import PpoConfig
from hotice.learn.ppo.dual_ppo import DualPpo
from hotice.learn.ppo.learner import MIRROR_ROWS
from hotice.learn.ppo.losses import clipped_surrogate, clipped_value
from hotice.learn.ppo.networks import ActorCritic
from hotice.learn.ppo.storage import Rollout
from hotice.sim.observations import mirror_action
from hotice.task.presets import DUAL, SINGLE

OBS, CRITIC, STEPS, ENVS = 11, 13, 4, 6


def make(agents=DUAL, **changes):
    torch.manual_seed(0)
    net = ActorCritic(agents, OBS, CRITIC, (16,), (16,), (0.6, 0.3))
    config = dataclasses.replace(PpoConfig(steps=STEPS, minibatches=2, mirror_weight=0.0), **changes)
    return DualPpo(net, config, lambda obs: obs.flip(-1), mirror_action, torch.Generator().manual_seed(1))


@torch.no_grad()
def filled(algo, seed=2):
    g, r = (
        torch.Generator().manual_seed(seed),
        Rollout(STEPS, ENVS, OBS, CRITIC, len(algo.net.agents), torch.device("cpu")),
    )
    for t in range(STEPS):
        r.obs[t], r.critic_obs[t] = torch.randn(ENVS, OBS, generator=g), torch.randn(ENVS, CRITIC, generator=g)
        r.value[t] = algo.net.values(r.critic_obs[t])
        r.action[t], r.mean[t], r.log_prob[t] = algo.sample(r.obs[t])
    r.advantage = torch.randn(r.advantage.shape, generator=g)
    return r


def batch_of(rollout):
    rollout.returns = rollout.advantage + rollout.value
    return next(rollout.minibatches(1, torch.Generator().manual_seed(0)))


def gradients(algo, batch):
    """Gradients of one minibatch's whole objective, by agent."""
    algo._descend = lambda: None
    algo._minibatch(batch, algo.net.std().detach())
    return {
        name: torch.cat([p.grad.flatten() for p in net.parameters() if p.grad is not None] or [torch.zeros(1)])
        for name, net in algo.net.nets.items()
    }


def test_log_probabilities_are_each_agents_own():
    algo = make()
    r = filled(algo)
    std = algo.net.std()
    low = torch.distributions.Normal(r.mean[0, :, :12], std[:12]).log_prob(r.action[0, :, :12]).sum(-1)
    up = torch.distributions.Normal(r.mean[0, :, 12:], std[12:]).log_prob(r.action[0, :, 12:]).sum(-1)
    torch.testing.assert_close(r.log_prob[0], torch.stack([low, up], dim=1))


def test_each_agents_advantage_moves_only_its_own_networks():
    algo = make(value_weight=0.0, entropy=0.0)
    batch = batch_of(filled(algo))
    both = gradients(algo, batch)
    assert both["low"].abs().max() > 0 and both["up"].abs().max() > 0
    low_only = dataclasses.replace(batch, advantage=batch.advantage * torch.tensor([1.0, 0.0]))
    alone = gradients(algo, low_only)
    torch.testing.assert_close(alone["low"], both["low"])
    assert (alone["up"] == 0).all()
    up_only = dataclasses.replace(batch, advantage=batch.advantage * torch.tensor([0.0, 1.0]))
    alone = gradients(algo, up_only)
    assert (alone["low"] == 0).all()
    torch.testing.assert_close(alone["up"], both["up"])


def test_returns_of_one_agent_do_not_move_the_others_critic():
    algo = make(entropy=0.0)
    batch = batch_of(filled(algo))
    before = gradients(algo, batch)
    changed = dataclasses.replace(batch, returns=batch.returns + torch.tensor([0.0, 1.0]))
    after = gradients(algo, changed)
    assert torch.equal(before["low"], after["low"]) and not torch.equal(before["up"], after["up"])


def test_the_objective_is_the_sum_of_both():
    algo = make(value_weight=0.7, entropy=0.01)
    batch, net = batch_of(filled(algo)), algo.net
    for p in net.parameters():
        p.data += 0.01 * torch.randn(p.shape, generator=torch.Generator().manual_seed(4))
    got = gradients(algo, batch)
    net.zero_grad()
    loss = 0.0
    for i, (name, part) in enumerate((("low", slice(0, 12)), ("up", slice(12, 20)))):
        agent = net.nets[name]
        p = torch.distributions.Normal(agent.actor(batch.obs), agent.log_std.exp())
        ratio = (p.log_prob(batch.action[:, part]).sum(-1) - batch.log_prob[:, i]).exp()
        value = agent.critic(batch.critic_obs)[:, 0]
        loss = loss + clipped_surrogate(ratio, batch.advantage[:, i], 0.2)
        loss = (
            loss + 0.7 * clipped_value(value, batch.value[:, i], batch.returns[:, i], 0.2) - 0.01 * agent.log_std.sum()
        )
    loss.backward()
    for name in ("low", "up"):
        expected = torch.cat([p.grad.flatten() for p in net.nets[name].parameters()])
        torch.testing.assert_close(got[name], expected, rtol=1e-4, atol=1e-6)


def test_the_mirror_loss_of_a_large_minibatch_is_estimated_from_some_rows():
    algo = make()
    obs = torch.randn(8 * MIRROR_ROWS, OBS, generator=torch.Generator().manual_seed(0))
    for p in algo.net.parameters():
        p.data += 0.1 * torch.randn(p.shape, generator=torch.Generator().manual_seed(4))
    with torch.no_grad():
        mean = algo.net.mean(obs)
        whole = (algo.net.mean(obs.flip(-1)) - mirror_action(mean)).square().mean()
        beginning = (algo.net.mean(obs[:100].flip(-1)) - mirror_action(mean[:100])).square().mean()
        part, few = algo._mirror_loss(obs, mean), algo._mirror_loss(obs[:100], mean[:100])
    assert part != whole and part == pytest.approx(float(whole), rel=0.05)
    assert few == pytest.approx(float(beginning))


def test_mirror_loss_pulls_towards_symmetry():
    algo = make(mirror_weight=1.0, value_weight=0.0, entropy=0.0, learning_rate=1e-2)
    r = filled(algo)
    obs = r.obs.flatten(0, 1)

    @torch.no_grad()
    def asymmetry():
        return float((algo.net.mean(obs.flip(-1)) - mirror_action(algo.net.mean(obs))).square().mean())

    for p in algo.net.parameters():
        p.data += 0.1 * torch.randn(p.shape, generator=torch.Generator().manual_seed(4))
    before = asymmetry()
    r.advantage.zero_()
    for _ in range(10):
        algo.update(r)
        r.advantage.zero_()
    assert asymmetry() < 0.7 * before


def test_good_actions_become_likelier():
    algo = make(value_weight=0.0, entropy=0.0)
    r = filled(algo)
    before, good = r.log_prob.clone(), r.advantage > 0.5
    algo.update(r)
    with torch.no_grad():
        after = algo._log_probs(r.action.flatten(0, 1), algo.net.mean(r.obs.flatten(0, 1)), algo.net.std()).view_as(
            before
        )
    assert (after - before)[good].mean() > 0.01


def test_advantages_are_normalised_per_agent():
    algo = make()
    r = filled(algo)
    r.advantage[..., 1] = 100.0 + 50.0 * r.advantage[..., 1]
    raw = r.advantage.clone()
    algo.update(r)
    flat = r.advantage.flatten(0, 1)
    torch.testing.assert_close(flat.mean(0), torch.zeros(2), atol=1e-5, rtol=0)
    torch.testing.assert_close(flat.std(0), torch.ones(2), atol=1e-4, rtol=0)
    torch.testing.assert_close(r.returns, raw + r.value, atol=1e-3, rtol=1e-4)


@pytest.mark.parametrize("kl, way", [(0.2, -1), (0.001, 1), (0.03, 0), (0.0, 0)])
def test_learning_rate_follows_the_divergence(kl, way):
    algo = make(target_kl=0.03, learning_rate=1e-3)
    algo._adapt(0, kl)
    rates = [group["lr"] for group in algo.optimizer.param_groups]
    assert (rates[0] > 1e-3) - (rates[0] < 1e-3) == way
    assert rates[1] == 1e-3, "the other agent's stays"
    for _ in range(50):
        algo._adapt(0, kl)
    assert 1e-5 <= algo.optimizer.param_groups[0]["lr"] <= algo.config.max_learning_rate


def test_a_gradient_that_is_not_finite_is_left_out_and_counted():
    algo = make()
    r = filled(algo)
    r.advantage[0, 0, 0] = float("nan")
    before = [p.detach().clone() for p in algo.net.parameters()]
    algo.update(r)
    assert algo.skipped == algo.config.epochs * algo.config.minibatches
    assert all(torch.equal(a, b) for a, b in zip(before, algo.net.parameters(), strict=True))
    algo.skipped_in_a_row = 100
    with pytest.raises(DivergedError, match="lower --max-learning-rate"):
        algo.update(r)


def test_minibatches_left_out_now_and_then_do_not_end_a_long_run():
    algo = make()
    algo.skipped_in_a_row, algo.skipped = 100, 10_000
    algo.update(filled(algo))
    assert (algo.skipped_in_a_row, algo.skipped) == (0, 10_000)


def test_standard_deviation_has_a_floor():
    algo = make(min_std=0.29)
    for net in algo.net.nets.values():
        net.log_std.data[:] = -5.0
    algo.update(filled(algo))
    assert float(algo.net.std().detach().min()) >= 0.29 - 1e-6


def test_single_agent_is_the_same_algorithm():
    algo = make(SINGLE)
    log = algo.update(filled(algo))
    assert {k for k in log if k.startswith("kl/")} == {"kl/whole"} and log["skipped_minibatches"] == 0


def test_minibatches_cover_the_rollout_once():
    algo = make()
    r = filled(algo)
    batches = list(r.minibatches(3, torch.Generator().manual_seed(0)))
    rows = torch.cat([b.obs for b in batches])
    assert len(batches) == 3 and rows.shape == (STEPS * ENVS, OBS)
    torch.testing.assert_close(rows.sort(0).values, r.obs.flatten(0, 1).sort(0).values)
    for b in batches:  # columns stay together
        torch.testing.assert_close(algo.net.mean(b.obs), b.mean)
