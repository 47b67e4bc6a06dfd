"""Distillation of planned picks: who drives, labels of the states that were seen, runs that go on."""

from dataclasses import replace
from pathlib import Path

import pytest
import torch

from hotice.errors import InvalidConfig
from hotice.learn.distill.pick_config import PickDistillConfig
from hotice.learn.distill.pick_dagger import PickDistillRunner
from hotice.learn.policy import torch_policy
from hotice.learn.ppo.config import PpoConfig

BOOK = Path(__file__).parents[2] / "sim" / "data" / "picks.npz"


def config(tmp_path, **changes):
    small = PpoConfig(steps=4, minibatches=2, epochs=2)
    given = dict(picks=BOOK, num_envs=8, out=tmp_path / "run", hidden=(16,), critic_hidden=(16,), threads=1, ppo=small)
    return PickDistillConfig(**(given | {"aggregate": 2, "updates": 2} | changes))


def test_the_share_of_the_student_grows_between_the_two_updates(tmp_path):
    cfg = config(tmp_path, teacher_updates=(10, 20))
    assert [cfg.share(u) for u in (0, 10, 15, 20, 99)] == [0.0, 0.0, 0.5, 1.0, 1.0]
    assert config(tmp_path, teacher_updates=(0, 0)).share(0) == 0.0
    assert config(tmp_path, teacher_updates=(0, 0)).share(1) == 1.0


@pytest.mark.parametrize("teacher_updates, driven", [((9, 9), 0), ((0, 2), 4)])
def test_labels_are_of_the_states_that_were_seen_whoever_drove(tmp_path, teacher_updates, driven):
    runner = PickDistillRunner(config(tmp_path, teacher_updates=teacher_updates))
    runner.update = 1 if driven else 0
    seen, done, step = [], [], runner.env.step
    runner.env.step = lambda action: (seen.append(runner.env.label()), done.append(action.clone()), step(action))[2]
    runner.collect()
    labels = runner.algo.labels
    assert torch.equal(labels.mean[0].view(4, 8, 20), torch.stack(seen))
    by_teacher = (torch.stack(done) == torch.stack(seen)).all(dim=2).all(dim=0)
    assert by_teacher.tolist() == [False] * driven + [True] * (8 - driven)


def test_a_robot_that_is_about_to_fall_is_the_teachers(tmp_path):
    runner = PickDistillRunner(config(tmp_path, teacher_updates=(0, 0), rescue_m=0.05))
    runner.update, env = 1, runner.env
    plain = env.snapshot
    off = torch.tensor([[0.0, 0.06], [0.04, 0.0], [0.04, 0.04], [0.0, 0.0]] * 2)
    env.snapshot = lambda ids=None: replace(plain(ids), offset=off if ids is None else off[ids])
    action = runner._act(0)
    assert (action == runner.wanted[0]).all(dim=1).tolist() == [True, False, True, False] * 2


def test_a_run_is_saved_resumed_and_read_as_a_policy(tmp_path):
    cfg = config(tmp_path)
    whole = PickDistillRunner(cfg)
    assert whole.train()
    other = replace(cfg, out=tmp_path / "other", updates=1)
    assert PickDistillRunner(other).train()
    resumed = PickDistillRunner(replace(other, updates=2, resume=True))
    assert resumed.update == 1 and resumed.train()
    for a, b in zip(whole.net.parameters(), resumed.net.parameters(), strict=True):
        assert torch.equal(a, b)
    policy = torch_policy(cfg.out)
    assert policy.act(whole.obs).shape == (8, 20)
    assert policy.meta["task"]["arm_scale_rad"] == 0.65


def test_waiting_robots_begin_at_different_times_and_their_episodes_count(tmp_path):
    runner = PickDistillRunner(config(tmp_path))
    step = runner.env.memory.step
    assert (step <= 0).all() and len(step.unique()) > 4
    assert runner.stats.whole.all()


@pytest.mark.parametrize(
    "changes, message",
    [
        ({"picks": None}, "no picks"),
        ({"teachers": (Path("a"),)}, "the book is the teacher"),
        ({"teacher_updates": (5, 4)}, "must not be less"),
        ({"rescue_m": 0.0}, "rescue_m"),
    ],
)
def test_what_cannot_be_is_refused(tmp_path, changes, message):
    with pytest.raises(InvalidConfig, match=message):
        config(tmp_path, **changes)
