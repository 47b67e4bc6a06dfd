"""What is refused before any work, or after it without a word lost: what came, what is allowed, how to mend it."""

import json
import shutil
from pathlib import Path

import pytest
import torch

from hotice.commands.configs import PlayConfig
from hotice.commands.line.benchmark_config import BenchmarkConfig
from hotice.commands.program import main
from hotice.commands.recipes import ReproduceConfig
from hotice.commands.reproduce import reproduce
from hotice.errors import CarryInfeasible, CheckpointError, InputError, InvalidConfig, UnknownName
from hotice.evaluate.config import EvaluateConfig
from hotice.evaluate.trials import Trials, TrialStore, read_trials
from hotice.learn.checkpoints.checkpoint import load_checkpoint
from hotice.learn.distill.config import FinetuneConfig
from hotice.learn.policy import load_policy
from hotice.learn.ppo.config import PpoConfig
from hotice.learn.train import runner
from hotice.learn.train.config import TrainConfig
from hotice.model.dynamics import DynamicsConfig
from hotice.model.object_range import ObjectRange
from hotice.model.shipped import load_scenes
from hotice.sim import TaskConfig
from hotice.sim.carry_bank import CarryBank
from hotice.task.sensing import SensingConfig


@pytest.mark.parametrize(
    "given, message",
    [
        (dict(out="x.png"), "the picture goes there"),
        (dict(video="film.gif"), "a film is an .mp4 file"),
        (dict(video_of=2), "give the film's file as video"),
        (dict(scenes=()), "no scenes"),
        (dict(seed=2**70), "0 to 2.63 - 1"),
    ],
)
def test_play(given, message):
    given = {k: Path(v) if isinstance(v, str) else v for k, v in given.items()}
    with pytest.raises(InvalidConfig, match=message):
        PlayConfig(policy="carry", **given)


@pytest.mark.parametrize("make", [TrainConfig, lambda **k: EvaluateConfig(policy="carry", scenes=("gap",), **k)])
def test_a_seed_that_no_generator_takes(make):
    with pytest.raises(InvalidConfig, match="seed is 1180591620717411303424: .*to 2.63 - 1"):
        make(seed=2**70)


def test_a_device_that_is_no_device():
    with pytest.raises(InvalidConfig, match="device is 'meta': auto, cpu, cuda or cuda:N"):
        TrainConfig(device="meta")


def test_numbers_of_environments_are_told_apart():
    with pytest.raises(InvalidConfig, match="num_envs is 0: a whole number of at least 1"):
        TrainConfig(num_envs=0)
    with pytest.raises(InvalidConfig, match="3 environments x 24 steps do not divide into 5 minibatches: change one"):
        TrainConfig(num_envs=3, ppo=PpoConfig(steps=24, minibatches=5))


@pytest.mark.parametrize("name, value, least", [("steps", 9, 10), ("updates", 0, 1), ("threads", 0, 1)])
def test_benchmark_names_the_number(name, value, least):
    with pytest.raises(InvalidConfig, match=f"{name} is {value}: a whole number of at least {least}"):
        BenchmarkConfig(**{name: value})


def test_an_episode_has_a_step():
    with pytest.raises(InvalidConfig, match="episode_s is 0.001: at least a control step, 0.02 s"):
        TaskConfig(episode_s=0.001)
    assert TaskConfig(episode_s=0.02).max_steps == 1


@pytest.mark.parametrize(
    "task",
    [
        TaskConfig(push_m_s=0.5),
        TaskConfig(sensing=SensingConfig(gravity=0.1)),
        TaskConfig(dynamics=DynamicsConfig(mass=0.2)),
    ],
)
def test_perturbations_by_hand_are_not_dropped(task):
    assert TrainConfig(task=task).task == task
    for make in (lambda: TrainConfig(task=task, perturbed=True), lambda: FinetuneConfig(task=task, init="x")):
        with pytest.raises(InvalidConfig, match="use --no-perturbed"):
            make()
    assert TrainConfig(task=TaskConfig().perturbed(), perturbed=True).perturbed


@pytest.mark.parametrize("path", ["carry", "no/where.onnx"])
def test_an_exported_policy_is_no_checkpoint(path):
    with pytest.raises(CheckpointError, match="is an exported policy.*checkpoint that it was exported from"):
        load_checkpoint(Path(path))


def test_a_run_named_like_a_shipped_policy_is_one(run):
    shutil.copytree(run, "carry")
    assert load_checkpoint(Path("carry"))[1]["update"] == 2


def test_no_name_at_all():
    with pytest.raises(UnknownName, match="unknown policy ''"):
        load_policy("")
    with pytest.raises(UnknownName, match="unknown scene ''"):
        load_scenes([""])


def test_objects_that_nobody_holds():
    heavy = ObjectRange(mass_kg=(100.0, 200.0))
    with pytest.raises(
        CarryInfeasible, match="0.2 m to 0.4 m and 100.0 kg to 200.0 kg cannot be held: give smaller or lighter"
    ):
        CarryBank.sample(heavy, 1, 0, 0.005, torch.device("cpu"))


def test_reproduce_asks_for_scenes_before_it_trains(tmp_path, monkeypatch):
    monkeypatch.setattr(runner, "Runner", lambda *_: pytest.fail("trained"))
    for what, given in (("table1", dict(bench=("nope",))), ("unseen", dict(unseen=("nope",), training=("gap",)))):
        with pytest.raises(UnknownName, match="unknown scene 'nope'"):
            reproduce(ReproduceConfig(what=what, out=tmp_path, **given))
    with pytest.raises(InvalidConfig, match="2.63"):
        ReproduceConfig(what="all", seed=2**70)


# trials that were kept


@pytest.fixture
def kept(tmp_path):
    """A folder with one block of one scene."""
    store = TrialStore(tmp_path / "trials", {"seed": 1}, ["gap"])
    store.add(0, 0, Trials(outcome=("fall", "success"), distance_m=(1.0, 0.09), time_s=(1.0, 3.0)))
    return tmp_path / "trials"


def test_trials_come_back(kept):
    store = TrialStore(kept, {"seed": 1}, ["gap"])
    assert store.blocks[0, 0].outcome == ("fall", "success") and not store.changed
    other = TrialStore(kept, {"seed": 2}, ["gap"])
    assert other.changed == ["seed"] and not other.blocks


@pytest.mark.parametrize(
    "content",
    ["{", "[]", '{"blocks": []}', '{"blocks": {"0": {"outcome": ["fall"], "distance_m": [], "time_s": [1]}}}', "{}"],
)
def test_a_damaged_file_of_trials_is_named(kept, content):
    (kept / "scene-000.json").write_text(content)
    with pytest.raises(InputError, match="scene-000.json: is no file of trials.*remove it"):
        TrialStore(kept, {"seed": 1}, ["gap"])


@pytest.fixture
def two_blocks(tmp_path):
    """Settings of five trials in blocks of three, and the file of a scene's trials."""
    settings, folder = {"seed": 1, "rollouts": 5, "batch": 3}, tmp_path / "blocks"
    store = TrialStore(folder, settings, ["gap"])
    for block, count in ((0, 3), (1, 2)):
        many = dict(distance_m=(0.5,) * count, time_s=(1.0,) * count, standing=(False,) * count)
        store.add(0, block, Trials(outcome=("fall",) * count, points=("success",) * count, **many))
    assert TrialStore(folder, settings, ["gap"]).blocks == store.blocks
    assert read_trials(folder)["gap"].rollouts == 5
    return settings, folder / "scene-000.json"


@pytest.mark.parametrize(
    "block, name, value, message",
    [
        (
            "0",
            "outcome",
            ["fall", "banana", "fall"],
            r"block 0: outcome\[1\] is 'banana': known are success, robot_coll",
        ),
        ("0", "points", [1, "fall", "fall"], r"block 0: points\[0\] is 1: known are success"),
        ("1", "distance_m", [float("nan"), 1.0], r"block 1: distance_m\[0\] is nan: a finite number of at least 0"),
        ("1", "distance_m", [1.0, -0.1], r"block 1: distance_m\[1\] is -0.1: a finite number of at least 0"),
        ("1", "time_s", [float("inf"), 1.0], r"block 1: time_s\[0\] is inf: a finite number"),
        ("1", "time_s", ["1", 1.0], r"block 1: time_s\[0\] is '1': a finite number"),
        ("1", "standing", [0, True], r"block 1: standing\[0\] is 0: true or false"),
        ("1", "outcome", [], "is no file of trials"),
        ("1", "nonsense", [1, 2], "is no file of trials"),
    ],
)
def test_trials_that_cannot_be_are_not_believed(two_blocks, block, name, value, message):
    settings, file = two_blocks
    content = json.loads(file.read_text())
    content["blocks"][block][name] = value
    file.write_text(json.dumps(content))
    for read in (lambda: TrialStore(file.parent, settings, ["gap"]), lambda: read_trials(file.parent)):
        with pytest.raises(InputError, match=message):
            read()


def test_a_depth_as_small_as_floats_are_is_one(two_blocks):
    settings, file = two_blocks
    content = json.loads(file.read_text())
    content["blocks"]["1"]["self_depth_m"] = [3e-17, 0.0]
    file.write_text(json.dumps(content))
    assert TrialStore(file.parent, settings, ["gap"]).blocks[0, 1].self_depth_m == (3e-17, 0.0)


@pytest.mark.parametrize("block, count", [("0", 500), ("1", 3), ("2", 3), ("-1", 3), ("٠", 3), ("a", 3)])
def test_blocks_have_the_trials_that_were_asked_for(two_blocks, block, count):
    settings, file = two_blocks
    content = json.loads(file.read_text())
    one = {"outcome": ["success"] * count, "distance_m": [0.0] * count, "time_s": [1.0] * count}
    content["blocks"] = {block: one}
    file.write_text(json.dumps(content))
    message = f"block {block} holds {count} trials" if block in "01" else "is not one of this evaluation"
    for read in (lambda: TrialStore(file.parent, settings, ["gap"]), lambda: read_trials(file.parent)):
        with pytest.raises(InputError, match=message):
            read()


@pytest.mark.parametrize("content", ["{", "[]", "null"])
def test_damaged_settings_start_anew(kept, content):
    (kept / "settings.json").write_text(content)
    store = TrialStore(kept, {"seed": 1}, ["gap"])
    assert store.changed == ["settings.json"] and not store.blocks
    store.add(0, 1, Trials(outcome=("fall",), distance_m=(1.0,), time_s=(1.0,)))
    assert json.loads((kept / "settings.json").read_text()) == {"seed": 1}
    assert list(TrialStore(kept, {"seed": 1}, ["gap"]).blocks) == [(0, 1)]


# observations of another kind


def test_the_scan_is_named_with_its_option(run, tiny_options, tmp_path, capfd):
    """Resuming needs the very observation; beginning with other networks may add rows, not drop them."""
    copy = tmp_path / "copy"
    shutil.copytree(run, copy)
    assert main(["train", "--out", str(copy), "--resume", *tiny_options, "--updates", "3", "--scan"]) == 2
    line = capfd.readouterr().err
    assert "201 numbers are read, 241 given" in line and "also gives scan (40): give --no-scan" in line


@pytest.fixture
def changed(run, tmp_path):
    """Function: a copy of the run with something else, or nothing, in the configuration that its checkpoint notes."""

    def change(*path, value=None):
        copy = tmp_path / "changed"
        shutil.copytree(run, copy)
        file = sorted(copy.glob("checkpoint-*"))[-1] / "meta.json"
        meta = json.loads(file.read_text())
        *way, last = ("config", *path)
        inner = meta
        for key in way:
            inner = inner[key]
        inner.pop(last)
        inner |= {} if value is None else {last: value}
        file.write_text(json.dumps(meta))
        return copy

    return change


@pytest.mark.parametrize(
    "path, value, message",
    [
        (("task",), -1, "leg_scale_rad|physics_dt_s"),
        (("task",), [], "physics_dt_s"),
        (("init_std",), [], "no checkpoint of"),
        (("task", "leg_scale_rad"), None, "leg_scale_rad is None"),
        (("task", "leg_scale_rad"), "x", "leg_scale_rad is 'x'"),
        (("task", "resolution_m"), [], "resolution_m is"),
        (("task", "scan"), 1, "scan is 1"),
        (("preset",), "x", "preset"),
    ],
)
def test_what_a_checkpoint_notes_is_not_trusted(changed, path, value, message):
    with pytest.raises((CheckpointError, UnknownName), match=message) as caught:
        load_policy(changed(*path, value=value))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["leg_scale_rad", "swing_height_m", "push_m_s"])
def test_numbers_beyond_single_precision(name):
    with pytest.raises(InvalidConfig, match=f"{name} is 1e.300: .* 1,000,000"):
        TaskConfig(**{name: 1e300})
