"""What a policy was trained on: written by every way of training, small, and good enough to make the scenes again."""

import dataclasses
import json
import shutil
from pathlib import Path

import pytest

import hotice.learn.checkpoints.trained_on as module
from hotice.errors import CheckpointError
from hotice.learn.checkpoints.checkpoint import META, read_meta, resolve
from hotice.learn.checkpoints.merge import merge
from hotice.learn.checkpoints.scene_record import SceneRecord
from hotice.learn.checkpoints.trained_on import TRAINED_ON, TrainedOn, in_words
from hotice.learn.checkpoints.training_scenes import TrainingScenes, whole_record
from hotice.learn.distill.config import DistillConfig
from hotice.learn.distill.dagger import DistillRunner
from hotice.learn.export import export_onnx
from hotice.learn.policy import load_policy, torch_policy
from hotice.learn.train.runner import Runner
from hotice.model.generate.families import family_scenes
from hotice.model.generate.family_names import family_of
from hotice.model.scene_digest import scene_digest
from hotice.model.shipped import load_scene, load_scenes

CHECKPOINTS = Path(__file__).parents[3] / "checkpoints"


def scenes_of(path):
    return [r.scenes for r in TrainedOn.of_meta(read_meta(resolve(path))).records]


def test_every_way_of_training_keeps_the_whole_line(run, tiny, tmp_path):
    def config(name, **changes):
        return tiny(tmp_path / name, **changes)

    assert scenes_of(run) == ["open_floor"]
    Runner(config("one", updates=1, scenes=("gap", "gap", "family:pipe:2"), init=run)).train()
    assert scenes_of(tmp_path / "one") == ["open_floor", "gap", "family:pipe:2:0"]
    Runner(config("one", updates=2, scenes=("gap", "pipe"), resume=True)).train()
    assert scenes_of(tmp_path / "one") == ["open_floor", "gap", "family:pipe:2:0", "pipe"]
    Runner(config("two", updates=1, scenes=("family:beam:2:3",), init=run)).train()
    merge([tmp_path / "one", tmp_path / "two"], tmp_path / "merged")
    whole = ["open_floor", "gap", "family:pipe:2:0", "pipe", "family:beam:2:3"]
    assert scenes_of(tmp_path / "merged") == whole
    base = config("student", updates=1, scenes=("beam",), average=0.0)
    wide = dataclasses.replace(base.task, history=1)
    given = {f.name: getattr(base, f.name) for f in dataclasses.fields(base)}
    given |= {"generalist": tmp_path / "merged", "init": run, "task": wide, "perturbed": False}
    DistillRunner(DistillConfig(**given)).train()
    student = [*whole, "beam"]
    assert scenes_of(tmp_path / "student") == student, "of its teacher too, and with more rows of the observation"
    meta = load_policy(export_onnx(torch_policy(tmp_path / "student"), tmp_path / "p.onnx")).meta
    assert [r["scenes"] for r in meta[TRAINED_ON]["scenes"]] == student
    assert meta["trained"]["on"]["families"] == {"beam": 3, "gap": 1, "open": 1, "pipe": 3}


def test_an_ancestor_without_a_record_leaves_a_gap(run, tiny, tmp_path):
    old = Path(shutil.copytree(resolve(run), tmp_path / "old"))
    meta = json.loads((old / META).read_text())
    del meta[TRAINED_ON]
    (old / META).write_text(json.dumps(meta))
    Runner(tiny(tmp_path / "next", init=old, scenes=("gap",), updates=1)).train()
    record = TrainedOn.of_meta(read_meta(resolve(tmp_path / "next")))
    assert record.unrecorded == (meta["sha256"],) and not record.whole
    described = torch_policy(tmp_path / "next").meta
    with pytest.raises(CheckpointError, match="a record with gaps: 1 checkpoints before it have none"):
        whole_record(described, "next")
    named = whole_record(described, "next", ("open_floor",))
    assert [(r.scenes, r.told_by) for r in named.records] == [("gap", "run"), ("open_floor", "hand")] and named.whole
    assert "not whole: 1 checkpoints" in in_words(record.summary())


def test_scenes_are_made_again_each_once():
    record = TrainedOn.of_items(("family:beam:4", "bench20", "bench20/01_side_gap", "family:beam:4:0"))
    assert len(record.records) == 3
    again = TrainingScenes.of(TrainedOn.from_json(json.loads(json.dumps(record.to_json()))))
    assert again.scenes == (*family_scenes("beam", 4), *load_scenes(["bench20"])) and again.left_out == ()
    assert record.holds(scene_digest(load_scene("bench20/07_beam_across")))
    assert not record.holds(scene_digest(load_scene("train75/13_beam_across")))


def test_scenes_that_changed_are_left_out_and_named(tmp_path):
    scenes = family_scenes("beam", 3)
    other = dataclasses.replace(scenes[2], goal=(1.9, 0.0))
    moved = TrainedOn(records=(SceneRecord.of("family:beam:3", [*scenes[:2], other]),)) | TrainedOn.of_items(["gap"])
    again = TrainingScenes.of(moved)
    assert [s.name for s in again.scenes] == ["beam_00", "beam_01", "gap"]
    (gone,) = again.left_out
    assert (gone.scenes, gone.missing, gone.count) == ("family:beam:3:0", 1, 3) and "others now" in gone.reason
    file = tmp_path / "room.json"
    other.save(file)
    named = TrainedOn.of_items([str(file)])
    file.unlink()
    with pytest.raises(CheckpointError, match="none of the training scenes can be made again"):
        TrainingScenes.of(named)


def test_a_run_is_believed_before_the_ledger():
    ledger, run = TrainedOn.of_items(["gap", "pipe"], "ledger"), TrainedOn.of_items(["gap"])
    for union in (ledger | run, run | ledger):
        assert {r.scenes: r.told_by for r in union.records} == {"gap": "run", "pipe": "ledger"}


def test_a_long_line_stays_small(monkeypatch):
    monkeypatch.setattr(module, "MAX_DIGESTS", 8)
    record = TrainedOn.of_items([f"family:gap:{n}" for n in (2, 6, 5)])
    assert [len(r.digests) for r in record.records] == [2, 0, 5]
    again = TrainingScenes.of(record)
    assert again.left_out == () and len(again.scenes) == 13 - 2, "the easiest scene is the same in all three"


@pytest.mark.parametrize("change", [{"count": 0}, {"digests": "abc"}, {"told_by": "nobody"}, {"families": 3}])
def test_records_that_cannot_be_are_refused(change):
    data = TrainedOn.of_items(["gap"]).to_json()
    data["scenes"][0] |= change
    with pytest.raises(CheckpointError, match=r"x\.onnx: trained_on is no record of training scenes"):
        TrainedOn.from_json(data, "x.onnx")
    with pytest.raises(CheckpointError, match="no record"):
        TrainedOn.from_json([1])


def test_families_by_name():
    names = {
        "unseen50/31_s_bend": "s_bend",
        "two_steps_s12_03": "two_steps",
        "beam_across_03": "beam_across",
        "beam_03": "beam",
        "indoor_living_room_012": "indoor",
        "open_floor": "open",
        "my_room": None,
        "one_pipe_thing_01": None,
        "gap_01b": None,
        "beam_s3": None,
    }
    assert {name: family_of(name) for name in names} == names
    for family in ("open", "combo", "hanging", "indoor"):
        assert {family_of(scene.name) for scene in family_scenes(family, 2, 3)} == {family}


@pytest.mark.parametrize("name", ["student", "teacher", "carry"])
def test_shipped_policies_say_what_they_were_trained_on(name):
    meta = load_policy(name).meta
    record = whole_record(meta, name)
    assert len(json.dumps(meta[TRAINED_ON])) < 40_000
    assert {r.told_by for r in record.records} == {"run", "ledger"}
    assert ("s_bend" in record.families, "hanging" in record.families) == (name == "student", True)
    assert ("bench20" in [r.scenes for r in record.records]) == (name != "carry")
    told = {r.scenes.removesuffix(":0") for r in record.records}
    assert set(meta["trained"]["scenes"]) <= told
    if name == "student":
        assert meta[TRAINED_ON] == read_meta(resolve(CHECKPOINTS / name))[TRAINED_ON]


def test_scenes_of_the_shipped_line_are_what_they_were():
    """A generator that changes gives other scenes than the policies were trained on: then this and `reproduce unseen`
    say so."""
    record = whole_record(load_policy("carry").meta, "carry")
    again = TrainingScenes.of(record)
    assert again.left_out == () and len(again.scenes) > 150
