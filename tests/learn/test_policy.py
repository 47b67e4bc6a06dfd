import json
from pathlib import Path

import numpy as np
import onnx
import onnxruntime
import pytest
import torch

from hotice.errors import CheckpointError, OutputError, UnknownName
from hotice.learn.export import export_onnx
from hotice.learn.policy import OnnxPolicy, check_layout, load_policy, torch_policy
from hotice.policy.policy_file import FORMAT, KEY
from hotice.sim.observations import POLICY, ObservationTable

CHECKPOINTS = Path(__file__).parents[2] / "checkpoints"
LAYOUT = ObservationTable(POLICY).layout()


def test_onnx_equals_torch(run, onnx_file):
    policy, exported = torch_policy(run), load_policy(onnx_file)
    norm = policy.net.obs_norm
    obs = norm.mean + 3.0 * norm.var.sqrt() * torch.randn(
        500, len(norm.mean), generator=torch.Generator().manual_seed(0)
    )
    a, b = policy.act(obs), exported.act(obs)
    assert a.abs().max() > 1e-3 and (a - b).abs().max() <= 1e-5
    for count in (1, 7):
        torch.testing.assert_close(exported.act(obs[:count]), b[:count], atol=1e-6, rtol=0)


def test_the_shipped_student_is_its_checkpoint():
    policy, shipped = torch_policy(CHECKPOINTS / "student"), load_policy("student")
    norm = policy.net.obs_norm
    obs = norm.mean + 3.0 * norm.var.sqrt() * torch.randn(
        500, len(norm.mean), generator=torch.Generator().manual_seed(0)
    )
    actions = policy.act(obs)
    assert actions.abs().max() > 1.0 and (actions - shipped.act(obs)).abs().max() < 1e-5
    assert {k: shipped.meta[k] for k in policy.meta} == policy.meta


def test_one_file_that_plain_onnxruntime_runs(onnx_file):
    assert [p.name for p in onnx_file.parent.iterdir()] == [onnx_file.name]
    session = onnxruntime.InferenceSession(str(onnx_file))
    assert [i.name for i in session.get_inputs()] == ["observation"] and [o.name for o in session.get_outputs()] == [
        "action"
    ]
    size = sum(w for _, w in LAYOUT)
    assert session.run(None, {"observation": np.zeros((3, size), np.float32)})[0].shape == (3, 20)


def test_it_does_not_tell_where_it_was_written(onnx_file):
    assert b"site-packages" not in onnx_file.read_bytes() and b"networks.py" not in onnx_file.read_bytes()


def test_it_describes_itself(onnx_file, run):
    meta = load_policy(onnx_file).meta
    assert meta["format"] == FORMAT and meta["preset"] == "dual_hodpf"
    assert [tuple(row) for row in meta["layout"]] == LAYOUT
    assert meta["trained"]["steps"] == 128 and meta["task"]["leg_scale_rad"] > 0
    check_layout(load_policy(onnx_file), LAYOUT)
    assert load_policy(run).meta["trained"] == meta["trained"]


def test_another_layout_is_refused(onnx_file):
    other = [(name, width + (name == "clock")) for name, width in LAYOUT]
    with pytest.raises(
        CheckpointError, match=r"observation layout differs.*first difference: the policy reads clock \(2\)"
    ):
        check_layout(load_policy(onnx_file), other)
    with pytest.raises(CheckpointError, match="another order"):
        check_layout(load_policy(onnx_file), LAYOUT[::-1])


def edit(path, out, change):
    model = onnx.load(path)
    change(model)
    onnx.save(model, out)
    return out


def change_meta(model, **values):
    entry = next(e for e in model.metadata_props if e.key == KEY)
    entry.value = json.dumps(json.loads(entry.value) | values)


def change_weight(model):
    weight = next(i for i in model.graph.initializer if len(i.raw_data) > 64)
    weight.raw_data = b"\0\0\0\0" + weight.raw_data[4:]


@pytest.mark.parametrize(
    "change, message",
    [
        (change_weight, "changed since it was exported"),
        (lambda m: change_meta(m, preset="single_hodpf"), "changed since it was exported"),
        (lambda m: change_meta(m, task={"leg_scale_rad": 3.0}), "changed since it was exported"),
        (lambda m: change_meta(m, format="hotice-policy/0"), "known is 'hotice-policy/1'"),
        (lambda m: m.metadata_props.__delitem__(slice(None)), "no hotice policy"),
    ],
)
def test_a_changed_file_is_refused(onnx_file, tmp_path, change, message):
    with pytest.raises(CheckpointError, match=message) as caught:
        load_policy(edit(onnx_file, tmp_path / "p.onnx", change))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("keep", [0, 10, 0.5, 0.999])
def test_a_truncated_file_is_refused(onnx_file, tmp_path, keep):
    content = onnx_file.read_bytes()
    path = tmp_path / "p.onnx"
    path.write_bytes(content[: keep if isinstance(keep, int) else int(keep * len(content))])
    with pytest.raises(CheckpointError) as caught:
        OnnxPolicy(path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("content", [b"hello", b"{}", b"\x80\x04K\x01."])
def test_other_files_are_refused(tmp_path, content):
    path = tmp_path / "p.onnx"
    path.write_bytes(content)
    with pytest.raises(CheckpointError):
        load_policy(path)


def test_names(tmp_path):
    with pytest.raises(UnknownName, match="or the path of an .onnx file"):
        load_policy("nobody")
    with pytest.raises(CheckpointError, match="no such policy"):
        load_policy("no/where")
    with pytest.raises(CheckpointError, match="no such file"):
        load_policy("gone.onnx")
    with pytest.raises(CheckpointError, match="no checkpoint here"):
        load_policy(tmp_path)


def test_export_to_a_missing_folder(run, tmp_path):
    with pytest.raises(OutputError, match="cannot write"):
        export_onnx(torch_policy(run), tmp_path / "no" / "p.onnx")
