"""What the actors read of the steps before: order, restarts, delays, reflection, and a state that goes on bit for
bit."""

import pytest
import torch

from hotice.errors import InvalidConfig
from hotice.model.objects import Box
from hotice.sim import TaskConfig, TransportEnv
from hotice.sim.observations import mirror_action
from hotice.sim.snapshot import Memory
from hotice.task.history import FRAME

STEPS = 3
COLUMNS = torch.cat([torch.arange(46), torch.arange(66, 86)])


def make(perturbed=False, **changes):
    from hotice.model import load_scenes

    task = TaskConfig(history=STEPS, **changes)
    return TransportEnv(
        6,
        load_scenes(["open_floor"]),
        Box((0.3, 0.3, 0.25), 1.0),
        config=task.perturbed() if perturbed else task,
        seed=2,
        threads=1,
    )


def frames(observation):
    return observation[:, -STEPS * FRAME :].view(-1, STEPS, FRAME)


@pytest.mark.parametrize("perturbed", [False, True])
def test_frames_are_what_was_read_the_newest_first(perturbed):
    env = make(perturbed)
    generator = torch.Generator().manual_seed(0)
    read = [env.reset()[0]]
    assert not frames(read[0]).any(), "nothing was before the beginning"
    for _ in range(5):
        step = env.step(0.3 * torch.randn(6, 20, generator=generator))
        assert not (step.outcome > 0).any()
        read.append(step.policy)
        for k in range(STEPS):
            wanted = read[-2 - k][:, COLUMNS] if len(read) >= 2 + k else torch.zeros(6, FRAME)
            assert torch.equal(frames(read[-1])[:, k], wanted), f"frame {k}"
    assert (read[-1][:, COLUMNS] != read[-2][:, COLUMNS]).any()
    critic = env.critic_table(env.snapshot())
    start = env.policy_table.size - STEPS * FRAME
    assert torch.equal(critic[:, start : start + STEPS * FRAME].reshape(6, STEPS, FRAME), frames(read[-1]))


def test_a_restart_forgets():
    env = make(episode_s=0.1)  # five steps
    env.reset()
    for _ in range(4):
        step = env.step(torch.full((6, 20), 0.2))
    assert frames(step.policy).any()
    step = env.step(torch.full((6, 20), 0.2))
    assert (step.outcome > 0).all() and not frames(step.policy).any()
    step = env.step(torch.zeros(6, 20))
    assert frames(step.policy)[:, 0].any() and not frames(step.policy)[:, 1:].any()


@pytest.mark.parametrize("perturbed", [False, True])
def test_a_stored_state_goes_on_bit_for_bit(perturbed):
    first, second = make(perturbed), make(perturbed)
    first.reset()
    second.reset()
    action = torch.full((6, 20), 0.1)
    for _ in range(3):
        last = first.step(action)
    policy, critic = second.load_state(first.state())
    assert torch.equal(policy, last.policy) and torch.equal(critic, last.critic)
    for _ in range(2):
        a, b = first.step(action), second.step(action)
        assert torch.equal(a.policy, b.policy) and torch.equal(a.critic, b.critic)


def test_it_reflects_frame_by_frame():
    env = make()
    env.reset()
    for k in range(4):
        step = env.step(torch.full((6, 20), 0.1 * k))
    mirrored = env.policy_table.mirror(step.policy)
    assert not torch.equal(mirrored, step.policy) and torch.equal(env.policy_table.mirror(mirrored), step.policy)
    for k in range(STEPS):
        assert torch.equal(frames(mirrored)[:, k, 46:], mirror_action(frames(step.policy)[:, k, 46:]))
        wanted = step.policy.clone()
        wanted[:, COLUMNS] = frames(step.policy)[:, k]
        assert torch.equal(frames(mirrored)[:, k], env.policy_table.mirror(wanted)[:, COLUMNS])


def test_without_a_history_nothing_is_kept():
    assert Memory.zeros(3, torch.device("cpu")).past.shape == (3, 0)


@pytest.mark.parametrize("steps", [-1, 51, 2.5, 2.0, True, "3"])
def test_impossible_lengths_are_refused(steps):
    with pytest.raises(InvalidConfig, match="history is .*whole number from 0 to 50"):
        TaskConfig(history=steps)
