"""Trials beside a training run: what they count, that they change nothing, where they and the configuration go."""

import sys
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from hotice.errors import InvalidConfig, MissingExtra, OutputError
from hotice.learn.checkpoints.average import AveragedPolicy
from hotice.learn.checkpoints.checkpoint import load_checkpoint
from hotice.learn.distill.pick_config import PickDistillConfig
from hotice.learn.train.runner import Runner
from hotice.learn.train.statistics import by_family
from hotice.learn.train.trials import TrialResults, Trials
from hotice.learn.train.wandb_sync import wandb_run
from hotice.learn.train.ways_picture import FAILURE, ways_figure
from hotice.task.rules import OUTCOMES

SCENES = ("open_floor", "gap")


def test_trials_change_nothing_of_the_training(tiny, tmp_path, capsys):
    Runner(tiny(tmp_path / "without", scenes=SCENES)).train()
    Runner(tiny(tmp_path / "with", scenes=SCENES, trials=3, checkpoint_updates=1)).train()
    a, b = load_checkpoint(tmp_path / "without")[0], load_checkpoint(tmp_path / "with")[0]
    assert set(a) == set(b) and all(torch.equal(a[k], b[k]) for k in a)
    assert capsys.readouterr().err.count("trials at ") == 2


def test_the_same_policy_gives_the_same_trials_and_the_average_is_what_acts(tiny, tmp_path):
    runner = Runner(tiny(tmp_path / "run", scenes=SCENES, trials=4))
    trials = Trials(runner.env, runner.config)
    first, again = (trials.run(runner.net, runner.average) for _ in range(2))
    for name in ("scene", "outcome", "distance_m"):
        np.testing.assert_array_equal(getattr(first, name), getattr(again, name))
    np.testing.assert_allclose(first.ways, again.ways, atol=1e-6)
    with torch.no_grad():
        for value in runner.net.parameters():
            value.zero_()
    np.testing.assert_allclose(trials.run(runner.net, runner.average).ways, first.ways, atol=1e-6)
    assert np.abs(trials.run(runner.net, AveragedPolicy(runner.net, 0.0)).ways - first.ways).max() > 1e-4


def test_a_trial_is_a_way_to_the_goal_and_ends_there(tiny, tmp_path):
    """Robots that begin at the goal arrive in the first step; those that time out are where their way ends."""
    runner = Runner(tiny(tmp_path / "run", scenes=("open_floor",), trials=2))
    trials = Trials(runner.env, runner.config)
    write = trials.env.starter.write

    def at_the_goal(physics, ids, *rest):
        write(physics, ids, *rest)
        way = torch.tensor(runner.env.bank.scenes[0].goal, dtype=physics.qpos.dtype) - physics.qpos[0, :2]
        physics.qpos[0, :2] += way
        physics.qpos[0, -7:-5] += way  # the object's place
        physics.forward(ids)

    trials.env.starter.write = at_the_goal
    results = trials.run(runner.net, runner.average)
    assert [OUTCOMES[i] for i in results.outcome] == ["success", "timeout"]
    goal = np.asarray(runner.env.bank.scenes[0].goal)
    assert results.distance_m[1] == pytest.approx(np.linalg.norm(results.ways[-1, 1] - goal), abs=1e-4)
    assert np.ptp(results.ways[:, 0], axis=0).max() == 0.0, "rests after the end"
    assert results.log()["trials/success"] == 0.5 and results.log()["trials/timeout"] == 0.5
    assert results.log()["trials/distance_m"] == pytest.approx(results.distance_m.mean())


def test_what_is_given_is_shown(tiny, tmp_path):
    """Solid where the scene is, ways in the colour of their outcome, numbers in the title."""
    bank = Runner(tiny(tmp_path / "run", scenes=SCENES)).env.bank
    codes = np.array([OUTCOMES.index(n) for n in ("success", "fall", "success")])
    ways = np.stack([np.linspace([0.0, 0.0], [1.0, 0.1 * i], 5) for i in range(3)], axis=1)
    figure = ways_figure(
        TrialResults(scene=np.array([1, 1, 0]), outcome=codes, distance_m=np.zeros(3), ways=ways), bank
    )
    assert [a.get_title() for a in figure.axes[:2]] == ["gap: 1 of 2", "open_floor: 1 of 1"]
    gap, empty = figure.axes[:2]
    lines = [line for line in gap.lines if len(line.get_xdata()) == 5]
    assert [line.get_color() for line in lines] == ["#15803d", FAILURE]
    np.testing.assert_allclose(lines[1].get_xydata(), ways[:, 1])
    solid = [path for c in gap.collections for path in c.get_paths() if len(path.vertices)]
    assert solid and not [path for c in empty.collections for path in c.get_paths() if len(path.vertices)]
    obstacle = next(o for o in bank.scenes[1].obstacles if abs(o.position_m[1]) > 0.2)
    assert any(path.contains_point(obstacle.position_m[:2]) for path in solid)


def test_arrivals_by_family():
    names = ["beam_s3_00", "beam_s3_01", "bench20/02_side_gap", "mine", "gap"]
    ended, good = torch.tensor([2.0, 2.0, 5.0, 1.0, 0.0]), torch.tensor([2.0, 1.0, 0.0, 1.0, 0.0])
    assert by_family(names, ended, good) == {"family/beam": 0.75, "family/other": 1.0, "family/side_gap": 0.0}


def test_tensorboard_has_families_trials_pictures_and_the_configuration(tiny, tmp_path):
    accumulator = pytest.importorskip("tensorboard.backend.event_processing.event_accumulator")
    task = replace(tiny(tmp_path).task, episode_s=0.1)
    config = tiny(tmp_path / "run", scenes=SCENES, trials=2, task=task, ppo=replace(tiny(tmp_path).ppo, steps=16))
    Runner(config).train()
    events = accumulator.EventAccumulator(str(tmp_path / "run" / "tensorboard"))
    events.Reload()
    tags = events.Tags()
    assert {"family/gap", "family/open", "trials/success", "trials/distance_m"} <= set(tags["scalars"])
    assert tags["images"] == ["trials/ways"] and events.Scalars("trials/success")[0].step == 256
    text = events.Tensors("configuration/text_summary")[0].tensor_proto.string_val[0].decode()
    assert "| num_envs | 8 |" in text and "| task.episode_s | 0.1 |" in text


def test_a_project_of_wandb_follows_tensorboard(tiny, tmp_path, monkeypatch):
    """The package stands in: a run is begun before the first event, told the configuration, and finished."""
    told = []

    class Error(Exception):
        pass

    def init(**given):
        if given["project"] == "locked":
            raise Error("not logged in")
        told.append(given)
        return SimpleNamespace(finish=lambda exit_code: told.append(exit_code))

    monkeypatch.setitem(sys.modules, "wandb", SimpleNamespace(init=init, Error=Error, __spec__=object()))
    Runner(tiny(tmp_path / "run", wandb="carry", updates=1)).train()
    begun, ended = told
    assert begun["project"] == "carry" and begun["sync_tensorboard"] and begun["config"]["num_envs"] == 8 and ended == 0
    with pytest.raises(OutputError, match="project locked: not logged in"):
        wandb_run(tiny(tmp_path / "run", wandb="locked"))
    assert wandb_run(tiny(tmp_path / "run")) is None


def test_what_cannot_be_is_refused(tiny, tmp_path, monkeypatch):
    with pytest.raises(InvalidConfig, match="trials is -1"):
        tiny(tmp_path, trials=-1)
    with pytest.raises(InvalidConfig, match="scored by `hotice pickup evaluate`"):
        PickDistillConfig(picks=tmp_path / "p.npz", trials=4)
    with pytest.raises(InvalidConfig, match="wandb is empty"):
        tiny(tmp_path, wandb=" ")
    monkeypatch.setitem(sys.modules, "wandb", None)
    with pytest.raises(MissingExtra, match=r"hotice\[wandb\]"):
        Runner(tiny(tmp_path / "run", wandb="carry"))
    assert not (tmp_path / "run").exists()
