"""Policies of checkpoints as ONNX files."""

from __future__ import annotations

import io
import json
import logging
import warnings
from pathlib import Path

import torch

from hotice.caches import settle_torch
from hotice.errors import CheckpointError
from hotice.files import write_bytes
from hotice.learn.policy import OnnxPolicy, TorchPolicy
from hotice.policy.policy_file import ACTION, KEY, OBSERVATION, content_hash


def export_onnx(policy: TorchPolicy, path: Path) -> Path:
    """Writes both actors and the normaliser to one ONNX file (`observation` (N, O) -> `action` (N, 20)).

    Raises `OutputError`, or `CheckpointError` when onnxruntime differs from torch by more than 1e-5.
    """
    import onnx

    size = sum(width for _, width in policy.meta["layout"])
    example = torch.zeros(2, size)
    settle_torch()
    logging.getLogger("torch.onnx").setLevel(logging.ERROR)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        program = torch.onnx.export(
            policy.net,
            (example,),
            input_names=[OBSERVATION],
            output_names=[ACTION],
            dynamo=True,
            verbose=False,
            dynamic_shapes={"raw_obs": {0: torch.export.Dim("batch")}},
        )
    assert program is not None
    model = program.model_proto
    for part in (model, model.graph, *model.graph.node, *model.graph.value_info, *model.graph.initializer):
        del part.metadata_props[:]  # torch notes where on this machine each operation was written
    meta = {**policy.meta, "sha256": content_hash(model, policy.meta)}
    model.metadata_props.append(onnx.StringStringEntryProto(key=KEY, value=json.dumps(meta)))
    buffer = io.BytesIO()
    onnx.save_model(model, buffer, save_as_external_data=False)
    check_export(policy, OnnxPolicy(path, content=buffer.getvalue()))
    return write_bytes(path, buffer.getvalue())


def check_export(policy: TorchPolicy, exported: OnnxPolicy, tolerance: float = 1e-5) -> float:
    """Largest difference over random observations. Raises `CheckpointError` above the tolerance."""
    generator = torch.Generator().manual_seed(0)
    norm = policy.net.obs_norm
    obs = norm.mean + norm.var.sqrt() * torch.randn(256, len(norm.mean), generator=generator)
    worst = float((policy.act(obs) - exported.act(obs)).abs().max())
    if not worst <= tolerance:
        raise CheckpointError(
            f"{exported.name}: exported policy differs from torch by {worst:.2g}, allowed {tolerance:g}"
        )
    return worst
