"""What a run begins from is read before anything is built, and must be finite."""

import json
import shutil
from pathlib import Path

import pytest
import torch
from safetensors.torch import load_file, save_file

from hotice.errors import CheckpointError
from hotice.learn.checkpoints.checkpoint import sha256
from hotice.learn.distill.config import DistillConfig
from hotice.learn.distill.dagger import DistillRunner
from hotice.learn.train.runner import Runner


def test_a_missing_checkpoint_is_told_before_anything_is_built(tiny, tmp_path, monkeypatch):
    monkeypatch.setattr("hotice.learn.train.run.TransportEnv", lambda *_, **__: pytest.fail("an environment was built"))
    with pytest.raises(CheckpointError, match="^gone: no checkpoint here"):
        Runner(tiny(tmp_path / "a", init=Path("gone")))
    for given in (dict(teachers=(Path("gone"),)), dict(generalist=Path("gone"))):
        with pytest.raises(CheckpointError, match="^gone: no checkpoint here"):
            DistillRunner(DistillConfig(out=tmp_path / "b", num_envs=8, **given))


@pytest.mark.parametrize("name", ["env.physics.qpos", "env.memory.last_action", "curriculum"])
def test_a_state_that_is_not_finite_is_not_gone_on_with(run, tiny, tmp_path, name):
    copy = tmp_path / "copy"
    shutil.copytree(run, copy)
    newest = sorted(copy.glob("checkpoint-*"))[-1]
    tensors = load_file(newest / "tensors.safetensors")
    tensors[name].view(-1)[0] = torch.nan
    save_file(tensors, newest / "tensors.safetensors")
    meta = json.loads((newest / "meta.json").read_text()) | {"sha256": sha256(newest / "tensors.safetensors")}
    (newest / "meta.json").write_text(json.dumps(meta))
    with pytest.raises(CheckpointError, match=f"{name} is not finite"):
        Runner(tiny(copy, resume=True, updates=3))
