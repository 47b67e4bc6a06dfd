import json
import shutil

import pytest
import torch

from hotice.errors import CheckpointError, OutputError
from hotice.learn.checkpoints import checkpoint
from hotice.learn.checkpoints.checkpoint import META, TENSORS, list_checkpoints, load_checkpoint, save_checkpoint

DATA = {"a": torch.arange(6.0).view(2, 3), "b": torch.tensor(3)}


@pytest.fixture
def saved(tmp_path):
    return save_checkpoint(tmp_path / "run", 7, DATA, {"note": "x"})


def test_what_was_saved_comes_back(saved):
    for path in (saved, saved.parent):
        tensors, meta = load_checkpoint(path)
        assert set(tensors) == {"a", "b"} and all(torch.equal(tensors[k], DATA[k]) for k in DATA)
        assert meta["update"] == 7 and meta["note"] == "x" and meta["format"] == checkpoint.FORMAT


def test_only_the_newest_stay(tmp_path):
    for update in (1, 2, 10, 11):
        save_checkpoint(tmp_path, update, DATA, {})
    assert [p.name for p in list_checkpoints(tmp_path)] == ["checkpoint-0000010", "checkpoint-0000011"]


def test_a_failed_write_leaves_the_last_one(saved, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(checkpoint, "save_file", full)
    with pytest.raises(OutputError, match="No space left"):
        save_checkpoint(saved.parent, 8, DATA, {})
    assert list(saved.parent.iterdir()) == [saved]
    load_checkpoint(saved.parent)


def test_a_half_written_folder_is_never_chosen_and_goes_away(saved):
    half = saved.parent / ".checkpoint-0000009.123"
    half.mkdir()
    shutil.copy(saved / META, half)
    assert load_checkpoint(saved.parent)[1]["update"] == 7
    save_checkpoint(saved.parent, 8, DATA, {})
    assert not half.exists()


def test_unreadable_places(tmp_path):
    with pytest.raises(OutputError, match="cannot be written"):
        (tmp_path / "file").write_text("")
        save_checkpoint(tmp_path / "file" / "run", 1, DATA, {})


def truncated(folder):
    content = (folder / TENSORS).read_bytes()
    (folder / TENSORS).write_bytes(content[: len(content) // 2])


def tampered(folder):
    content = bytearray((folder / TENSORS).read_bytes())
    content[-3] ^= 1
    (folder / TENSORS).write_bytes(bytes(content))


def older(folder):
    meta = json.loads((folder / META).read_text())
    (folder / META).write_text(json.dumps(meta | {"format": "hotice-checkpoint/0"}))


def said(**values):
    def damage(folder):
        meta = json.loads((folder / META).read_text())
        (folder / META).write_text(json.dumps(meta | values))

    return damage


DAMAGE = {
    "steps is 1e\\+300": said(steps=1e300),
    "steps is -1": said(steps=-1),
    "update is True": said(update=True),
    "minutes is inf": said(minutes=float("inf")),
    "truncated or changed": truncated,
    "SHA-256": tampered,
    "known is 'hotice-checkpoint/1'": older,
    "not whole": lambda f: (f / TENSORS).unlink(),
    "is not JSON": lambda f: (f / META).write_text("{"),
    "format is 'list'": lambda f: (f / META).write_text("[]"),
    "no checkpoint here": lambda f: shutil.rmtree(f),
}


@pytest.mark.parametrize("message", DAMAGE)
def test_damage_is_said_in_one_line(saved, message):
    DAMAGE[message](saved)
    with pytest.raises(CheckpointError, match=message) as caught:
        load_checkpoint(saved)
    assert "\n" not in str(caught.value) and str(saved) in str(caught.value)
