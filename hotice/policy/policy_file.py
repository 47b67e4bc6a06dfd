"""A policy as one ONNX file that holds normaliser and actors, read and run without PyTorch.

The file carries its own description (preset, observation layout, task constants, what trained it) and the SHA-256 of
both, so a changed file or one for another observation is refused when it is loaded.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hotice.errors import CheckpointError, UnknownName
from hotice.machine import usable_cores
from hotice.task.history import FRAME

FORMAT = "hotice-policy/1"
POLICIES = Path(__file__).resolve().parents[1] / "policies"
KEY = "hotice"
OBSERVATION, ACTION = "observation", "action"


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
        self._session = onnxruntime.InferenceSession(content, options, providers=["CPUExecutionProvider"])

    @property
    def layout(self) -> list[tuple[str, int]]:
        """Names and widths of the observation's rows."""
        return [(name, width) for name, width in self.meta["layout"]]

    def run(self, observation: NDArray[np.float32]) -> NDArray[np.float32]:
        """Actions (N, 20) of raw observations (N, O)."""
        return np.asarray(self._session.run([ACTION], {OBSERVATION: observation})[0])


def shipped_policies() -> tuple[str, ...]:
    """Names of the policies that come with hotice."""
    return tuple(sorted(p.stem for p in POLICIES.glob("*.onnx")))


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
    try:
        meta = json.loads(entries[KEY])
    except ValueError:
        raise CheckpointError(f"{path}: description of the policy is not JSON: the file was changed") from None
    if not isinstance(meta, dict) or meta.get("format") != FORMAT:
        got = meta.get("format") if isinstance(meta, dict) else type(meta).__name__
        raise CheckpointError(f"{path}: policy format is {got!r}: known is {FORMAT!r}")
    del model.metadata_props[:]
    if content_hash(model, {k: v for k, v in meta.items() if k != "sha256"}) != meta.get("sha256"):
        raise CheckpointError(f"{path}: truncated or changed since it was exported (SHA-256 differs)")
    check_finite(model.graph, path)
    return meta


def check_finite(graph: Any, path: Path) -> None:
    """Raises `CheckpointError` when a weight or constant of an ONNX graph is NaN or infinite."""
    from onnx import numpy_helper

    attributes = [(node, a) for node in graph.node for a in node.attribute]
    numbers = [(f"{node.op_type}'s {a.name}", np.array([a.f, *a.floats])) for node, a in attributes]
    tensors = [(tensor.name, tensor) for tensor in graph.initializer]
    for node, a in attributes:
        tensors += [(f"{node.op_type}'s {a.name}", t) for t in (*([a.t] if a.HasField("t") else []), *a.tensors)]
    try:
        numbers += [(name, numpy_helper.to_array(tensor)) for name, tensor in tensors]
    except (ValueError, TypeError) as error:
        raise CheckpointError(f"{path}: a tensor cannot be read: {str(error).splitlines()[0]}") from None
    for name, values in numbers:
        if values.dtype.kind == "f" and not np.isfinite(values).all():
            raise CheckpointError(f"{path}: {name} is not finite: the run had diverged, export an older checkpoint")


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
        return [(str(row), int(width)) for row, width in layout]
    except (TypeError, ValueError):
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
        return path.read_bytes()
    except OSError as error:
        raise CheckpointError(f"{path}: cannot be read: {error.strerror or error}") from None
