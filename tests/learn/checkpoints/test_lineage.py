"""Environment steps of everything behind a checkpoint."""

import dataclasses
import json
import shutil
from pathlib import Path

import pytest

from hotice.commands.paper_tables import Made, origins_markdown
from hotice.errors import CheckpointError
from hotice.learn.checkpoints.checkpoint import META, load_checkpoint, read_meta, resolve
from hotice.learn.checkpoints.lineage import line_of, total_steps
from hotice.learn.checkpoints.merge import merge
from hotice.learn.distill.config import DistillConfig
from hotice.learn.distill.dagger import DistillRunner
from hotice.learn.policy import torch_policy
from hotice.learn.train.runner import Runner


def test_branches_count_their_ancestor_once(run, tiny, tmp_path):
    root = read_meta(resolve(run))
    assert root["ancestors"] == {} and total_steps(root) == root["steps"] > 0
    for seed in (1, 2):
        Runner(tiny(tmp_path / f"branch{seed}", init=run, seed=seed, updates=seed)).train()
    one, two = (read_meta(resolve(tmp_path / f"branch{seed}")) for seed in (1, 2))
    assert one["ancestors"] == two["ancestors"] == {root["sha256"]: root["steps"]}
    merged = read_meta(merge([tmp_path / "branch1", tmp_path / "branch2"], tmp_path / "merged"))
    whole = root["steps"] + one["steps"] + two["steps"]
    assert total_steps(merged) == whole and two["steps"] == 2 * one["steps"]
    again = read_meta(merge([tmp_path / "merged", tmp_path / "branch1"], tmp_path / "again"))
    assert total_steps(again) == whole, "an average adds no steps, and a part is counted once"
    Runner(tiny(tmp_path / "next", init=tmp_path / "merged", updates=1)).train()
    last = read_meta(resolve(tmp_path / "next"))
    assert total_steps(last) == whole + last["steps"]
    trained = torch_policy(tmp_path / "next").meta["trained"]
    assert (trained["steps"], trained["total_steps"]) == (last["steps"], whole + last["steps"])


def test_a_resumed_run_keeps_its_line(run, tiny, tmp_path):
    Runner(tiny(tmp_path / "branch", init=run, updates=1)).train()
    before = read_meta(resolve(tmp_path / "branch"))
    Runner(tiny(tmp_path / "branch", resume=True, updates=2)).train()
    after = read_meta(resolve(tmp_path / "branch"))
    assert after["steps"] == 2 * before["steps"] and after["ancestors"] == before["ancestors"] != {}


def test_a_student_owes_to_its_teachers(run, tiny, tmp_path):
    base = {f.name: getattr(tiny(tmp_path), f.name) for f in dataclasses.fields(tiny(tmp_path))}
    teacher = read_meta(resolve(run))
    DistillRunner(DistillConfig(**(base | {"out": tmp_path / "student", "teachers": (run,), "updates": 1}))).train()
    assert read_meta(resolve(tmp_path / "student"))["ancestors"] == {teacher["sha256"]: teacher["steps"]}


def test_tables_tell_what_came_before():
    report = {
        "policy": "student",
        "preset": "dual_hodpf",
        "source": {},
        "perturbed": True,
        "trained": {"steps": 5, "total_steps": 12, "updates": 1, "minutes": 1.0, "seed": 0},
    }
    made = {"generalist": Made(report=report, evaluated_by="hotice evaluate", trained_by=None)}
    assert "trained for 5 steps after 7 of the checkpoints that it began from (1 updates" in origins_markdown(made)
    report["trained"]["total_steps"] = 5
    assert "trained for 5 steps (1 updates" in origins_markdown(made)


@pytest.mark.parametrize("line", [[], {"abc": -1}, {"abc": True}, {"abc": "7"}, 3])
def test_impossible_lines_are_refused(run, tmp_path, line):
    folder = Path(shutil.copytree(resolve(run), tmp_path / "copy"))
    meta = json.loads((folder / META).read_text())
    (folder / META).write_text(json.dumps(meta | {"ancestors": line}))
    with pytest.raises(CheckpointError, match="ancestors is .*: steps by SHA-256 are needed"):
        load_checkpoint(folder)


@pytest.mark.parametrize("nested", [False, True])
def test_a_resumed_average_counts_its_parts_once(run, tiny, tmp_path, nested):
    for seed in (1, 2):
        Runner(tiny(tmp_path / f"branch{seed}", init=run, seed=seed, updates=1)).train()
    merge([tmp_path / "branch1", tmp_path / "branch2"], tmp_path / ("inner" if nested else "merged"))
    if nested:
        merge([tmp_path / "inner", tmp_path / "branch2"], tmp_path / "merged")
    before = total_steps(read_meta(resolve(tmp_path / "merged")))
    Runner(tiny(tmp_path / "merged", seed=1, resume=True, updates=2)).train()
    assert (
        total_steps(read_meta(resolve(tmp_path / "merged")))
        == before + read_meta(resolve(tmp_path / "branch1"))["steps"]
    )


@pytest.mark.parametrize("more", [{}, {"merged": [{"steps": 7, "sha256": "def"}]}])
def test_an_older_checkpoint_counts_its_own_steps(more):
    meta = {"sha256": "abc", "steps": 7} | more
    assert total_steps(meta) == 7 and line_of(meta) == {"abc": 7}
