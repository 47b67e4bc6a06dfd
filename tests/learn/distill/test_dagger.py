import dataclasses
from pathlib import Path

import pytest
import torch

from hotice.errors import CheckpointError, InvalidConfig
from hotice.learn.checkpoints.checkpoint import load_checkpoint
from hotice.learn.distill.config import DistillConfig
from hotice.learn.distill.dagger import DistillRunner
from hotice.learn.distill.labels import Labels, ReplayBuffer
from hotice.learn.policy import torch_policy
from hotice.learn.train.runner import Runner


@pytest.fixture(scope="session")
def student(tiny, run):
    """Function: a tiny distillation of the tiny run."""

    def make(out, **changes):
        base = {f.name: getattr(tiny(out), f.name) for f in dataclasses.fields(tiny(out))}
        return DistillConfig(**(base | {"teachers": (run,), "perturbed": True} | changes))

    return make


def test_a_student_that_is_its_teacher_in_an_exact_world_has_nothing_to_learn(student, run, tmp_path):
    runner = DistillRunner(student(tmp_path, perturbed=False))
    runner.net.load_state_dict(torch_policy(run).net.state_dict())
    runner.collect()
    assert torch.equal(runner.sensed, runner.truth)
    labels = next(runner.algo.labels.minibatches(1, torch.Generator().manual_seed(0)))
    torch.testing.assert_close(runner.net.act(labels.obs), labels.mean)
    log = runner.algo._minibatch(next(runner.rollout.minibatches(1, runner.algo.generator)), labels)
    assert log["kl/low"] == pytest.approx(0.0, abs=1e-5) and log["kl/up"] == pytest.approx(0.0, abs=1e-5)


def test_teachers_see_the_truth_and_students_what_sensors_tell(student, tmp_path):
    runner = DistillRunner(student(tmp_path))
    runner.collect()
    columns = runner.env.policy_table.columns(("last_action",))
    assert torch.equal(runner.sensed[..., columns], runner.truth[..., columns])
    assert (runner.sensed - runner.truth).abs().max() > 0.01
    mean, _ = runner.algo.teachers.label(runner.truth.flatten(0, 1), runner.scene.flatten())
    torch.testing.assert_close(runner.algo.labels.mean[0], mean)


def test_the_divergence_is_of_both_agents_from_their_teacher(student, tmp_path):
    runner = DistillRunner(student(tmp_path))
    runner.collect()
    net, algo = runner.net, runner.algo
    runner.rollout.returns = runner.rollout.value.clone()
    labels = next(algo.labels.minibatches(1, torch.Generator().manual_seed(0)))
    student = torch.distributions.Normal(net.act(labels.obs), net.std())
    teacher = torch.distributions.Normal(labels.mean, algo.teachers.std[labels.teacher])
    kl = torch.distributions.kl_divergence(student, teacher).detach()
    log = algo._minibatch(next(runner.rollout.minibatches(1, algo.generator)), labels)
    assert log["kl/low"] == pytest.approx(float(kl[:, :12].sum(1).mean()), rel=1e-4)
    assert log["kl/up"] == pytest.approx(float(kl[:, 12:].sum(1).mean()), rel=1e-4)


def test_learning_brings_the_student_to_its_teacher(student, tmp_path):
    config = student(tmp_path)
    runner = DistillRunner(dataclasses.replace(config, ppo=dataclasses.replace(config.ppo, learning_rate=5e-3)))
    runner.collect()
    critic = runner.net.nets["low"].critic[0].weight.clone()
    first, *_, last = (runner.algo.update(runner.rollout) for _ in range(40))
    for agent in ("low", "up"):
        assert last[f"kl/{agent}"] < 0.3 * first[f"kl/{agent}"]
    assert not torch.equal(runner.net.nets["low"].critic[0].weight, critic)


def test_without_exploration_the_student_acts_by_its_mean(student, tmp_path):
    runner = DistillRunner(student(tmp_path, exploration=0.0))
    action, mean, _ = runner.algo.sample(torch.zeros(3, runner.env.policy_table.size))
    assert torch.equal(action, mean)


def test_the_buffer_keeps_the_last_rollouts():
    buffer, generator = ReplayBuffer(3, 4, 2, torch.device("cpu")), torch.Generator().manual_seed(0)
    for k in range(5):
        value = torch.full((4, 1), float(k))
        buffer.add(Labels(obs=value.expand(4, 2), mean=value.expand(4, 20), teacher=torch.full((4,), k)))
    assert sorted(buffer.teacher[:, 0].tolist()) == [2, 3, 4]
    batches = list(buffer.minibatches(2, generator))
    assert [len(b.teacher) for b in batches] == [2, 2]
    assert all((b.obs[:, 0] == b.teacher).all() and (b.mean[:, 7] == b.teacher).all() for b in batches)
    other = ReplayBuffer(3, 4, 2, torch.device("cpu"))
    other.load_state(buffer.state())
    assert other.added == 5 and torch.equal(other.obs, buffer.obs)


def test_resuming_a_distillation_is_bit_for_bit(student, tmp_path):
    changes = dict(aggregate=2, teachers=(), scenes=("open_floor", "gap"))
    changes["generalist"] = student(tmp_path).teachers[0]
    DistillRunner(student(tmp_path / "whole", updates=4, **changes)).train()
    DistillRunner(student(tmp_path / "parts", updates=2, **changes)).train()
    DistillRunner(student(tmp_path / "parts", updates=4, resume=True, **changes)).train()
    a, b = (load_checkpoint(tmp_path / name)[0] for name in ("whole", "parts"))
    assert set(a) == set(b) and "replay.obs" in a
    assert [k for k in a if not torch.equal(a[k], b[k])] == []


def test_a_run_is_not_resumed_with_other_teachers_or_another_objective(student, tiny, run, tmp_path):
    out = tmp_path / "student"
    DistillRunner(student(out, updates=1)).train()
    Runner(tiny(tmp_path / "other", updates=1, seed=5)).train()
    with pytest.raises(CheckpointError, match="not those that the student began with"):
        DistillRunner(student(out, updates=2, resume=True, teachers=(tmp_path / "other",)))
    with pytest.raises(CheckpointError, match="was trained by 'dagger', not 'ppo'"):
        Runner(tiny(out, updates=2, resume=True))


@pytest.mark.parametrize(
    "changes, message",
    [
        (dict(teachers=()), "no teachers"),
        (dict(aggregate=0), "aggregate is 0"),
        (dict(exploration=1.5), "exploration is 1.5"),
    ],
)
def test_impossible_distillations_are_refused(student, tmp_path, changes, message):
    with pytest.raises(InvalidConfig, match=message):
        student(tmp_path, **changes)


def test_teachers_have_the_form_of_policies():
    """NAME=PATH, as `hotice reproduce --policies` takes it, or a path alone."""
    named = DistillConfig(teachers=(Path("specialist=a"), Path("b=c"), Path("generalist=d")))
    assert named.teachers == (Path("a"), Path("b=c")) and named.generalist == Path("d")
    with pytest.raises(InvalidConfig, match="2 generalists"):
        DistillConfig(teachers=(Path("generalist=a"),), generalist=Path("b"))
    with pytest.raises(InvalidConfig, match="specialist=PATH is needed"):
        DistillConfig(teachers=(Path("specialist="),))
