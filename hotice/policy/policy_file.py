"""A policy as one ONNX file that holds normaliser and actors, read and run without PyTorch.

The file carries its own description (preset, observation layout, task constants, what trained it) and the SHA-256 of
both, so a changed file or one for another observation is refused when it is loaded.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hotice import checks
from hotice.documents import parse_json
from hotice.errors import CheckpointError, InputError, UnknownName
from hotice.files import read_bytes
from hotice.machine import usable_cores
from hotice.model.g1 import ACTIONS
from hotice.policy.onnx_graph import MOST_WIDTH, graph_fault
from hotice.task.history import FRAME

FORMAT = "hotice-policy/1"
POLICIES = Path(__file__).resolve().parents[1] / "policies"
KEY = "hotice"
OBSERVATION, ACTION = "observation", "action"
MAX_BYTES = 256 * 2**20
MOST_ROWS = 1000


class PolicySession:
    """An exported policy, run by onnxruntime on the CPU with `threads` threads (0: all usable cores).

    `content`: of the file, read from `path` when it is not given. `meta` has preset, layout (names and widths of the
    observation) and task constants. Raises `CheckpointError`.
    """

    def __init__(self, path: Path, name: str | None = None, threads: int = 0, content: bytes | None = None) -> None:
        import onnxruntime

        self.name = name or str(path)
        content = _read(path) if content is None else content
        self.meta = read_onnx_meta(content, path)
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = threads or usable_cores()
        options.log_severity_level = 3
        try:
            self._session = onnxruntime.InferenceSession(content, options, providers=["CPUExecutionProvider"])
            trial = self.run(np.zeros((2, sum(width for _, width in self.layout)), np.float32))
        except _runtime_errors() as error:
            raise CheckpointError(f"{path}: onnxruntime cannot run it: {_first_line(error)}") from None
        if trial.shape != (2, ACTIONS):
            raise CheckpointError(
                f"{path}: gives actions of shape {trial.shape} for 2 robots: (2, {ACTIONS}) is needed"
            )

    @property
    def layout(self) -> list[tuple[str, int]]:
        """Names and widths of the observation's rows."""
        return _rows(self.name, self.meta["layout"])

    def run(self, observation: NDArray[np.float32]) -> NDArray[np.float32]:
        """Actions (N, 20) of raw observations (N, O). Raises `CheckpointError` where onnxruntime gives up."""
        try:
            return np.asarray(self._session.run([ACTION], {OBSERVATION: observation})[0])
        except _runtime_errors() as error:
            raise CheckpointError(f"{self.name}: onnxruntime cannot run it: {_first_line(error)}") from None


def shipped_policies() -> tuple[str, ...]:
    """Names of the policies that come with hotice."""
    return tuple(sorted(p.stem for p in POLICIES.glob("*.onnx")))


def check_name(policy: str) -> None:
    """Raises `UnknownName` or `CheckpointError` unless it is a shipped policy or the path of something; reads none."""
    if policy in shipped_policies() or os.path.exists(policy):
        return
    path = Path(policy)
    if path.suffix == ".onnx" or len(path.parts) > 1:
        raise CheckpointError(f"{path}: no such policy file or checkpoint folder")
    raise UnknownName("policy", policy, shipped_policies(), "the path of an .onnx file or a checkpoint folder")


def open_policy(name_or_path: str | Path, threads: int = 1) -> PolicySession:
    """A shipped policy by name, or an ONNX file. Raises `CheckpointError` or `UnknownName`."""
    text = str(name_or_path)
    if text in shipped_policies():
        return PolicySession(POLICIES / f"{text}.onnx", text, threads)
    path = Path(text)
    if path.suffix == ".onnx" or len(path.parts) > 1:
        return PolicySession(path, threads=threads)
    raise UnknownName("policy", text, shipped_policies(), "the path of an .onnx file")


def read_onnx_meta(content: bytes, path: Path) -> dict[str, Any]:
    """Description in an ONNX policy. Raises `CheckpointError` for another file, a changed one or another version."""
    import onnx

    try:
        model = onnx.load_model_from_string(content)
    except Exception as error:  # protobuf raises many kinds, all meaning: not an ONNX file
        raise CheckpointError(f"{path}: is no ONNX file (truncated or changed): {type(error).__name__}") from None
    entries = {e.key: e.value for e in model.metadata_props}
    if KEY not in entries:
        raise CheckpointError(f"{path}: is an ONNX file but no hotice policy: write one with `hotice export`")
    meta = parse_json(f"{path}: description of the policy", entries[KEY], CheckpointError)
    if not isinstance(meta, dict) or meta.get("format") != FORMAT:
        got = meta.get("format") if isinstance(meta, dict) else type(meta).__name__
        raise CheckpointError(f"{path}: policy format is {checks.shown(got)}: known is {FORMAT!r}")
    del model.metadata_props[:]
    if content_hash(model, {k: v for k, v in meta.items() if k != "sha256"}) != meta.get("sha256"):
        raise CheckpointError(f"{path}: truncated or changed since it was exported (SHA-256 differs)")
    _check_meta(str(path), meta)
    width = sum(width for _, width in _rows(str(path), meta["layout"]))
    if fault := graph_fault(model, (OBSERVATION, width), (ACTION, ACTIONS)):
        raise CheckpointError(f"{path}: is no policy as `hotice export` writes it: {fault}")
    _check_finite(model.graph, path)
    return meta


def _check_finite(graph: Any, path: Path) -> None:
    """Raises `CheckpointError` when a weight or a number of a sound graph is NaN or infinite."""
    from onnx import numpy_helper

    numbers = [
        (f"{node.op_type}'s {a.name}", np.array([a.f, *a.floats])) for node in graph.node for a in node.attribute
    ]
    for name, values in [*numbers, *((t.name, numpy_helper.to_array(t)) for t in graph.initializer)]:
        if not np.isfinite(values).all():
            raise CheckpointError(f"{path}: {name} is not finite: the run had diverged, export an older checkpoint")


def _check_meta(name: str, meta: dict[str, Any]) -> None:
    """Raises `CheckpointError` for a description that lacks what readers rely on."""
    for key, kind in (("preset", str), ("layout", list), ("task", dict)):
        if not isinstance(meta.get(key), kind):
            raise CheckpointError(f"{name}: {key} is {checks.shown(meta.get(key))}: the file was changed")
    if not isinstance(meta.get("trained", {}), dict):
        raise CheckpointError(f"{name}: trained is {checks.shown(meta['trained'])}: the file was changed")


def check_layout(name: str, theirs: Sequence[Sequence[Any]], layout: Sequence[tuple[str, int]]) -> None:
    """Raises `CheckpointError` unless policy `name`, which reads `theirs`, reads exactly the observation `layout`."""
    rows, given = _rows(name, theirs), [(name, width) for name, width in layout]
    if rows == given:
        return
    wrong = [f"the policy reads {a} ({n})" for a, n in rows if (a, n) not in given]
    wrong += [f"the environment also gives {a} ({n})" for a, n in given if (a, n) not in rows]
    raise CheckpointError(
        f"{name}: observation layout differs from the environment's: {sum(n for _, n in rows)} numbers are read, "
        f"{sum(n for _, n in given)} given; first difference: {(wrong or ['another order'])[0]}{_mend(rows, given)}"
    )


def _rows(name: str, layout: Any) -> list[tuple[str, int]]:
    """Names and widths as a file gives them. Raises `CheckpointError` for anything else."""
    try:
        rows = [(str(row), int(width)) for row, width in layout]
        if not all(0 < width <= MOST_WIDTH for _, width in rows) or len(rows) > MOST_ROWS:
            raise ValueError("impossible widths")
        return rows
    except (TypeError, ValueError, OverflowError):
        raise CheckpointError(
            f"{name}: its observation layout is no list of names and widths: the file was changed"
        ) from None


def _mend(rows: list[tuple[str, int]], given: list[tuple[str, int]]) -> str:
    """Advice where the rows that can be switched on are all the difference."""
    extra = ("scan", "history")
    theirs, ours = dict(rows), dict(given)
    if [r for r in rows if r[0] not in extra] != [r for r in given if r[0] not in extra] or theirs == ours:
        return ""
    flags = [] if ("scan" in theirs) == ("scan" in ours) else ["--scan" if "scan" in theirs else "--no-scan"]
    if theirs.get("history") != ours.get("history"):
        flags.append(f"--history {theirs.get('history', 0) // FRAME}")
    return f": give {' '.join(flags)}, or a policy for this observation"


def content_hash(model: Any, meta: dict[str, Any]) -> str:
    """SHA-256 of an ONNX graph without metadata and of what the file says of itself."""
    content = model.SerializeToString(deterministic=True) + json.dumps(meta, sort_keys=True).encode()
    return hashlib.sha256(content).hexdigest()


def _read(path: Path) -> bytes:
    try:
        return read_bytes(path, MAX_BYTES)
    except InputError as error:
        raise CheckpointError(str(error)) from None


@cache
def _runtime_errors() -> tuple[type[Exception], ...]:
    """Errors of onnxruntime, which have no common kind of their own."""
    from onnxruntime.capi import onnxruntime_pybind11_state as state

    found = [value for value in vars(state).values() if isinstance(value, type) and issubclass(value, Exception)]
    return tuple(found)


def _first_line(error: Exception) -> str:
    return (str(error).strip().splitlines() or [type(error).__name__])[0][:200]
