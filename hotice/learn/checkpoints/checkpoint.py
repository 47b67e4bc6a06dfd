"""Checkpoints: a folder each, tensors as safetensors and the rest as JSON, no pickle anywhere.

A checkpoint is written to a folder aside and renamed, so it exists whole or not at all; `meta.json` holds the SHA-256
of the tensors, so a truncated or changed file is refused. The newest whole checkpoint of a run is where training
resumes.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
from pathlib import Path
from typing import Any

import safetensors
import torch
from safetensors.torch import load_file, save_file
from torch import Tensor

from hotice import checks
from hotice.documents import read_json
from hotice.errors import CheckpointError, OutputError
from hotice.files import is_file, is_folder
from hotice.learn.checkpoints.lineage import ANCESTORS
from hotice.policy.policy_file import shipped_policies

FORMAT = "hotice-checkpoint/1"
TENSORS, META = "tensors.safetensors", "meta.json"
PREFIX = "checkpoint-"
MAX_META_BYTES = 64 * 2**20
MAX_TENSORS_BYTES = 16 * 2**30


def save_checkpoint(run: Path, update: int, tensors: dict[str, Tensor], meta: dict[str, Any], keep: int = 2) -> Path:
    """Writes `run/checkpoint-UPDATE` and removes all but the newest `keep`. Raises `OutputError`."""
    final = run / f"{PREFIX}{update:07d}"
    aside, replaced = run / f".{final.name}.{os.getpid()}", run / f".{final.name}.{os.getpid()}.old"
    try:
        run.mkdir(parents=True, exist_ok=True)
        for stale in run.glob(f".{PREFIX}*"):
            shutil.rmtree(stale, ignore_errors=True)
        aside.mkdir()
        flat = {k: v.detach().cpu().contiguous().clone() for k, v in tensors.items()}
        save_file(flat, aside / TENSORS)
        meta = {"format": FORMAT, "update": update, "sha256": sha256(aside / TENSORS), **meta}
        (aside / META).write_text(json.dumps(meta, indent=1) + "\n")
        for name in (TENSORS, META):
            with open(aside / name, "rb") as file:
                os.fsync(file.fileno())
        if final.exists():  # moved first: removing it takes longer than a kill
            os.replace(final, replaced)
        os.replace(aside, final)
        shutil.rmtree(replaced, ignore_errors=True)
    except OSError as error:
        raise OutputError(f"{final}: checkpoint cannot be written: {error.strerror or error}") from None
    except safetensors.SafetensorError as error:  # how it reports a disk that is full
        raise OutputError(f"{final}: checkpoint cannot be written: {error}") from None
    finally:
        shutil.rmtree(aside, ignore_errors=True)
    for old in list_checkpoints(run)[:-keep]:
        shutil.rmtree(old, ignore_errors=True)
    return final


def list_checkpoints(run: Path) -> list[Path]:
    """Checkpoint folders of a run, oldest first."""
    return sorted(p for p in run.glob(f"{PREFIX}*") if p.is_dir())


def updates_of(folder: Path) -> int:
    """Number of updates in the name of a checkpoint folder; -1 for another name."""
    number = folder.name.removeprefix(PREFIX)
    return int(number) if number.isdecimal() else -1


def resolve(path: Path) -> Path:
    """A checkpoint folder from a path to it or to its run. Raises `CheckpointError`."""
    if is_file(path / META):
        return path
    if path.suffix == ".onnx" or (str(path) in shipped_policies() and not is_folder(path)):
        raise CheckpointError(
            f"{path}: is an exported policy, actors without critics and optimiser: the checkpoint that it was exported "
            "from, or its run, is needed"
        )
    found = list_checkpoints(path) if is_folder(path) else []
    if not found:
        raise CheckpointError(
            f"{path}: no checkpoint here: a folder {PREFIX}NUMBER, or a run that holds some, is needed"
        )
    return found[-1]


def read_meta(folder: Path) -> dict[str, Any]:
    """`meta.json` of a checkpoint. Raises `CheckpointError`."""
    meta = read_json(folder / META, MAX_META_BYTES, CheckpointError)
    if not isinstance(meta, dict) or meta.get("format") != FORMAT:
        got = meta.get("format") if isinstance(meta, dict) else type(meta).__name__
        raise CheckpointError(f"{folder / META}: checkpoint format is {checks.shown(got)}: known is {FORMAT!r}")
    _check_counters(folder / META, meta)
    return meta


def _check_counters(path: Path, meta: dict[str, Any]) -> None:
    """Raises `CheckpointError` for counters that no training can have reached."""
    for name in ("update", "steps"):
        checks.whole(f"{path}: {name}", meta.get(name, 0), checks.INT64, CheckpointError)
    behind = meta.get(ANCESTORS, {})
    if not isinstance(behind, dict) or any(
        isinstance(n, bool) or not isinstance(n, int) or n < 0 for n in behind.values()
    ):
        raise CheckpointError(
            f"{path}: {ANCESTORS} is {checks.shown(behind)}: steps by SHA-256 are needed, integers of at least 0"
        )
    checks.number(f"{path}: minutes", meta.get("minutes", 0.0), checks.NOT_NEGATIVE, CheckpointError)


def load_checkpoint(path: Path, device: torch.device | str = "cpu") -> tuple[dict[str, Tensor], dict[str, Any]]:
    """Tensors and meta of a checkpoint (or of the newest in a run). Raises `CheckpointError`."""
    folder = resolve(path)
    meta = read_meta(folder)
    file = folder / TENSORS
    if not is_file(file):
        raise CheckpointError(f"{file}: no such file: the checkpoint is not whole")
    if file.stat().st_size > MAX_TENSORS_BYTES:
        raise CheckpointError(f"{file}: is larger than {MAX_TENSORS_BYTES // 2**30} GiB")
    try:
        if sha256(file) != meta.get("sha256"):
            raise CheckpointError(f"{file}: truncated or changed since it was written (SHA-256 differs)")
        return load_file(file, device=str(device)), meta
    except OSError as error:
        raise CheckpointError(f"{file}: cannot be read: {error.strerror or error}") from None
    except (safetensors.SafetensorError, ValueError) as error:
        raise CheckpointError(f"{file}: is no safetensors file: {error}") from None


def sha256(path: Path) -> str:
    """Hash of a file, in hexadecimal."""
    digest = hashlib.sha256()
    with open(path, "rb") as file:
        for block in iter(lambda: file.read(1 << 20), b""):
            digest.update(block)
    return digest.hexdigest()
