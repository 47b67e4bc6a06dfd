import json
import subprocess
import sys

import numpy as np
import pytest
import torch

from hotice.errors import CheckpointError, UnknownName
from hotice.policy import PolicyTask, open_policy, shipped_policies
from hotice.policy.observation import LAYOUT, SIZE
from hotice.policy.policy_file import check_layout
from hotice.task.config import TaskConfig
from hotice.task.presets import PRESETS


def test_shipped_policy_acts_as_through_torch():
    from hotice.learn.policy import load_policy

    observation = np.random.default_rng(0).standard_normal((5, SIZE)).astype(np.float32)
    policy = open_policy("carry")
    np.testing.assert_array_equal(policy.run(observation), load_policy("carry").act(torch.from_numpy(observation)))
    check_layout(policy.name, policy.layout, LAYOUT)
    assert "carry" in shipped_policies()


def test_it_needs_no_torch():
    code = "import sys; from hotice.policy import open_policy; import hotice.policy.observation; open_policy('carry')"
    code += "; assert 'torch' not in sys.modules and 'pinocchio' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)


def test_names():
    with pytest.raises(UnknownName, match=r"known are carry, student, teacher, or the path of an \.onnx file"):
        open_policy("nobody")
    with pytest.raises(CheckpointError, match="no such file"):
        open_policy("no/where.onnx")


def test_task_constants():
    task = PolicyTask.from_meta(open_policy("carry").meta)
    assert task.control_dt_s == pytest.approx(0.02) and task.object_field == "ogf"
    defaults = TaskConfig()
    for name in vars(task):
        if name != "object_field":
            assert getattr(PolicyTask(), name) == getattr(defaults, name)
    for name, preset in PRESETS.items():
        meta = {"preset": name, "task": vars(task)}
        assert PolicyTask.from_meta(meta).object_field == preset.object_field


def test_the_scan_is_off_unless_the_file_says_so():
    meta = open_policy("carry").meta
    assert not PolicyTask.from_meta(meta).scan
    assert PolicyTask.from_meta(meta | {"task": meta["task"] | {"scan": True}}).scan
    with pytest.raises(CheckpointError, match="scan is 1"):
        PolicyTask.from_meta(meta | {"task": meta["task"] | {"scan": 1}})


@pytest.mark.parametrize("value", [True, -1, 51, 2.0, "3"])
def test_an_impossible_history_is_named(value):
    meta = open_policy("carry").meta
    assert PolicyTask.from_meta(meta).history == 0
    with pytest.raises(CheckpointError, match="history is .* from 0 to 50"):
        PolicyTask.from_meta(meta | {"task": meta["task"] | {"history": value}})


@pytest.mark.parametrize("value", [None, True, "0.3", float("nan"), -1.0])
def test_an_impossible_constant_is_named(value):
    meta = open_policy("carry").meta
    changed = meta | {"task": meta["task"] | {"leg_scale_rad": value}}
    with pytest.raises(CheckpointError, match="leg_scale_rad"):
        PolicyTask.from_meta(changed)
    with pytest.raises(CheckpointError, match="preset is 'x'"):
        PolicyTask.from_meta(meta | {"preset": "x"})


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("substeps", 2.5),
        ("substeps", 0),
        ("physics_dt_s", 1e-12),
        ("speed_m_s", 0),
        ("resolution_m", 0),
        ("gait_hz", 1e300),
    ],
)
def test_constants_that_no_task_has_are_refused(name, value):
    meta = open_policy("carry").meta
    with pytest.raises(CheckpointError, match=f"constant {name} is "):
        PolicyTask.from_meta(meta | {"task": meta["task"] | {name: value}})


def test_another_observation_is_told_with_what_to_give():
    wider = (*LAYOUT, ("scan", 40))
    with pytest.raises(
        CheckpointError, match=r"p: .*201 numbers are read, 241 given.*also gives scan \(40\): give --no-scan"
    ):
        check_layout("p", LAYOUT, wider)
    with pytest.raises(
        CheckpointError, match=r"241 numbers are read, 201 given.*policy reads scan \(40\): give --scan"
    ):
        check_layout("p", wider, LAYOUT)
    with pytest.raises(CheckpointError, match=r"give --scan --history 2, or a policy for this observation$"):
        check_layout("p", (*wider, ("history", 132)), LAYOUT)
    with pytest.raises(CheckpointError, match=r"give --history 0, or a policy for this observation$"):
        check_layout("p", LAYOUT, (*LAYOUT, ("history", 66)))
    with pytest.raises(CheckpointError, match=r"first difference: the policy reads clock \(2\)$"):
        check_layout("p", LAYOUT, [row for row in wider if row[0] != "clock"])
    with pytest.raises(CheckpointError, match="another order$"):
        check_layout("p", LAYOUT, LAYOUT[::-1])
    check_layout("p", [list(row) for row in LAYOUT], LAYOUT)


@pytest.mark.parametrize("layout", ["x", None, -1, [1], [["gyro"]], [["gyro", "three"]], {"gyro": 3}])
def test_a_layout_that_is_none(layout):
    with pytest.raises(CheckpointError, match="no list of names and widths"):
        check_layout("p", layout, LAYOUT)


@pytest.mark.parametrize("where", ["initializer", "number"])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_weights_that_are_not_finite_are_refused(tmp_path, where, value):
    """As in checkpoints; the hash of the file is right."""
    import onnx

    from hotice.policy.policy_file import KEY, POLICIES, content_hash

    model = onnx.load_model(str(POLICIES / "carry.onnx"))
    entry = next(e for e in model.metadata_props if e.key == KEY)
    graph = model.graph
    if where == "initializer":
        name = "nets.up.actor.2.weight"
        tensor = next(t for t in graph.initializer if t.name == name)
        values = onnx.numpy_helper.to_array(tensor).copy()
        values[3, 5] = value
        tensor.CopyFrom(onnx.numpy_helper.from_array(values, name))
    else:
        name = "Gemm's alpha"
        next(a for n in graph.node if n.op_type == "Gemm" for a in n.attribute if a.name == "alpha").f = value
    del model.metadata_props[:]
    meta = {k: v for k, v in json.loads(entry.value).items() if k != "sha256"}
    meta["sha256"] = content_hash(model, meta)
    model.metadata_props.append(onnx.StringStringEntryProto(key=KEY, value=json.dumps(meta)))
    onnx.save_model(model, str(tmp_path / "bad.onnx"))
    with pytest.raises(CheckpointError, match=f"bad.onnx: {name} is not finite: the run had diverged, export an older"):
        open_policy(tmp_path / "bad.onnx")


def test_shipped_policies_are_finite():
    assert [open_policy(name).name for name in shipped_policies()] == list(shipped_policies())


def test_what_onnxruntime_refuses_is_an_error_of_ours():
    """So that a station or a runner that catches a controller's errors answers it."""
    with pytest.raises(CheckpointError, match="student: onnxruntime cannot run it: .*"):
        open_policy("student").run(np.zeros((1, 3), np.float32))
