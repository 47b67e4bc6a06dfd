"""The rows of Table I differ by one switch each, number of agents and field of hands and object, and by nothing
else."""

import dataclasses

import pytest
import torch

from hotice.learn.ppo.networks import ActorCritic
from hotice.learn.train.config import TrainConfig, config_to_dict
from hotice.model import Box, load_scene
from hotice.model.carry import solve_carry
from hotice.sim import TaskConfig
from hotice.sim.carry_bank import CarryBank
from hotice.sim.env import TransportEnv
from hotice.sim.rewards import L, S, U
from hotice.task.presets import PRESETS

SWITCHES = [
    ("agents", "single_sgf", "dual_sgf"),
    ("agents", "single_hodpf", "dual_hodpf"),
    ("object_field", "single_sgf", "single_hodpf"),
    ("object_field", "dual_sgf", "dual_hodpf"),
]


@pytest.fixture(scope="module")
def envs():
    """An environment of each preset, all after the same steps from the same seed."""
    carry = CarryBank.of([solve_carry(Box((0.3, 0.3, 0.3), 1.0))], 0.005, torch.device("cpu"))
    made = {
        name: TransportEnv(2, [load_scene("pillars")], carry, name, seed=0, config=TaskConfig(), threads=1)
        for name in PRESETS
    }
    for env in made.values():
        generator = torch.Generator().manual_seed(0)
        env.reset()
        for _ in range(5):
            env.step(0.3 * torch.randn(2, 20, generator=generator))
    return made


def network(env):
    torch.manual_seed(0)
    return ActorCritic(env.agents, env.policy_table.size, env.critic_table.size, (32, 16), (32, 16), (0.6, 0.3))


@pytest.mark.parametrize("switch, a, b", SWITCHES)
def test_neighbours_differ_by_one_switch(switch, a, b):
    rows = [vars(PRESETS[name]) for name in (a, b)]
    assert [key for key in rows[0] if rows[0][key] != rows[1][key]] == [switch]


def test_the_four_are_all_combinations():
    switches = {(len(p.agents), p.object_field) for p in PRESETS.values()}
    assert len(PRESETS) == 4 and switches == {(1, "sgf"), (1, "ogf"), (2, "sgf"), (2, "ogf")}


def test_training_is_configured_the_same_but_for_the_name():
    configs = [config_to_dict(TrainConfig(preset=name)) for name in PRESETS]
    assert len({c.pop("preset") for c in configs}) == 4
    assert all(c == configs[0] for c in configs)


def test_observations_rewards_and_terminations_are_the_same_tables(envs):
    first = envs["dual_hodpf"]
    for env in envs.values():
        assert env.policy_table.layout() == first.policy_table.layout()
        assert env.critic_table.layout() == first.critic_table.layout()
        assert env.rewards.rows == first.rewards.rows
        assert env.config == first.config and torch.equal(env.action_scale, first.action_scale)


def test_the_same_actions_move_the_same_bodies(envs):
    """Presets differ in what is observed and rewarded, never in the physics."""
    first = envs["dual_hodpf"].physics
    assert all(torch.equal(env.physics.qpos, first.qpos) for env in envs.values())


@pytest.mark.parametrize("switch, a, b", SWITCHES)
def test_a_snapshot_differs_only_by_the_object_field(envs, switch, a, b):
    one, other = (envs[name].snapshot() for name in (a, b))
    for field in dataclasses.fields(one):
        if field.name == "grasp":
            continue
        x, y = getattr(one, field.name), getattr(other, field.name)
        if isinstance(x, tuple):
            same = all(map(torch.equal, x, y))
        else:
            same = torch.equal(x, y) if torch.is_tensor(x) else x == y
        assert same or (switch, field.name) == ("object_field", "ogf"), field.name
    assert switch == "agents" or not torch.equal(one.ogf.force_W, other.ogf.force_W)


def test_the_agents_share_or_split_the_same_rewards(envs):
    """The single agent receives every term once; the two agents receive the shared ones in both streams."""
    for field in ("hodpf", "sgf"):
        single, dual = envs[f"single_{field}"], envs[f"dual_{field}"]
        (whole, terms), (streams, same) = (env.rewards(env.snapshot()) for env in (single, dual))
        assert torch.equal(terms, same)
        dt = single.config.control_dt_s
        by_set = {
            who: sum(t * r.weight * dt for r, t in zip(single.rewards.rows, terms.T, strict=True) if r.agents == who)
            for who in (L, U, S)
        }
        torch.testing.assert_close(whole[:, 0], by_set[L] + by_set[U] + by_set[S])
        torch.testing.assert_close(streams[:, 0], by_set[L] + by_set[S])
        torch.testing.assert_close(streams[:, 1], by_set[U] + by_set[S])


def test_networks_have_the_same_shapes_whatever_the_field(envs):
    for agents in ("dual", "single"):
        shapes = [
            {k: v.shape for k, v in network(envs[f"{agents}_{field}"]).state_dict().items()}
            for field in ("sgf", "hodpf")
        ]
        assert shapes[0] == shapes[1]


def test_each_agent_has_the_network_that_a_single_one_has(envs):
    """But for the last layer, whose rows are the joints: twelve and eight, or twenty."""
    dual, single = network(envs["dual_hodpf"]), network(envs["single_hodpf"])
    (whole,) = single.agents
    for agent in dual.agents:
        ours, theirs = dual.nets[agent.name].state_dict(), single.nets[whole.name].state_dict()
        differing = {k for k in ours if ours[k].shape != theirs[k].shape}
        assert ours.keys() == theirs.keys() and differing == {"actor.4.weight", "actor.4.bias", "log_std"}
    assert sum(a.size for a in dual.agents) == whole.size == 20
    observation = torch.randn(3, envs["dual_hodpf"].policy_table.size)
    assert dual.act(observation).shape == single.act(observation).shape == (3, 20)
