from types import SimpleNamespace

import pytest
import torch

from hotice.errors import CheckpointError
from hotice.learn.checkpoints.checkpoint import load_checkpoint, save_checkpoint
from hotice.learn.distill.teachers import Teachers, columns_in
from hotice.learn.policy import torch_policy
from hotice.learn.train.config import config_to_dict


@pytest.fixture
def teacher(run, tmp_path):
    """Function: a copy of the tiny run that says it was trained on these scenes, its actors moved by `shift`."""

    def make(name, scenes, shift=0.0, **config):
        tensors, meta = load_checkpoint(run)
        tensors = {k: v + shift if k.endswith("actor.2.bias") else v for k, v in tensors.items()}
        meta = {k: v for k, v in meta.items() if k not in ("format", "sha256", "update")}
        meta |= {"scenes": list(scenes), "config": {**meta["config"], **config}}
        save_checkpoint(tmp_path / name, 1, tensors, meta)
        return tmp_path / name

    return make


@pytest.fixture
def load(run, tiny):
    """Function: teachers of a student that carries through these scenes."""
    layout_of_run = [tuple(row) for row in load_checkpoint(run)[1]["layout"]]

    def make(specialists, scenes, generalist=None, task=None, preset="dual_hodpf", layout=layout_of_run):
        env = SimpleNamespace(
            bank=SimpleNamespace(names=list(scenes)),
            device=torch.device("cpu"),
            policy_table=SimpleNamespace(layout=lambda: layout),
        )
        task = config_to_dict(tiny("x").task) | (task or {})
        return Teachers.load(specialists, generalist, env, task, preset)

    return make


def test_each_scene_has_the_most_special_teacher(teacher, load):
    wide, narrow = teacher("wide", ["a", "b", "c"]), teacher("narrow", ["b"])
    rest = teacher("rest", ["z"])
    teachers = load([wide, narrow], ["b", "a", "d"], rest)
    assert [list(teachers.sources)[k].split("/")[-2] for k in teachers.of_scene] == ["narrow", "wide", "rest"]
    assert len(load([wide, narrow], ["a", "c"]).nets) == 1, "who teaches nowhere is left out"


def test_a_student_may_read_more_than_its_teacher(teacher, load, run):
    layout = [tuple(row) for row in load_checkpoint(run)[1]["layout"]]
    same = load([teacher("one", ["a"])], ["a"])
    wide = load([teacher("one", ["a"])], ["a"], layout=[("scan", 40), *layout, ("history", 66)])
    obs, scene = torch.randn(4, len(same.nets[0].obs_norm.mean)), torch.zeros(4, dtype=torch.int64)
    more = torch.cat([torch.rand(4, 40), obs, torch.rand(4, 66)], dim=1)
    assert torch.equal(wide.label(more, scene)[0], same.label(obs, scene)[0])
    with pytest.raises(CheckpointError, match="first difference: the policy reads gyro"):
        load([teacher("one", ["a"])], ["a"], layout=layout[1:])


def test_a_student_that_reads_less_is_told_what_it_lacks():
    policy = SimpleNamespace(name="teacher", meta={"layout": [["gyro", 3], ["scan", 40]]})
    assert columns_in(policy, [("gyro", 3), ("scan", 40), ("history", 66)]).tolist() == list(range(43))
    with pytest.raises(CheckpointError, match=r"reads scan \(40\): give --scan, or"):
        columns_in(policy, [("gyro", 3), ("history", 66)])


def test_labels_are_of_the_teacher_of_the_scene(teacher, load):
    paths = [teacher("one", ["a"], 0.0), teacher("two", ["b"], 1.0)]
    teachers = load(paths, ["b", "a"])
    generator = torch.Generator().manual_seed(0)
    obs = torch.randn(9, len(teachers.nets[0].obs_norm.mean), generator=generator)
    scene = torch.randint(0, 2, (9,), generator=generator)
    mean, who = teachers.label(obs, scene)
    for k in range(9):
        path = paths[1] if scene[k] == 0 else paths[0]
        torch.testing.assert_close(mean[k], torch_policy(path).act(obs[k : k + 1])[0])
        torch.testing.assert_close(teachers.std[who[k]], torch_policy(path).net.std().detach())


def test_scenes_without_a_teacher_are_named(teacher, load):
    with pytest.raises(CheckpointError, match=r"no teacher was trained on b, c \(2 of 3 scenes\): give"):
        load([teacher("one", ["a"])], ["a", "b", "c"])


def test_teachers_of_another_kind_are_refused(teacher, load, tmp_path):
    path = teacher("one", ["a"])
    with pytest.raises(CheckpointError, match="teaches 'dual_hodpf', the student is 'dual_sgf'"):
        load([path], ["a"], preset="dual_sgf")
    with pytest.raises(CheckpointError, match="leg_scale_rad 0.3, the student has 0.5"):
        load([path], ["a"], task={"leg_scale_rad": 0.5})
    with pytest.raises(CheckpointError, match="no checkpoint here"):
        load([tmp_path / "nothing"], ["a"])
