"""What an exported policy may consist of: the few operations of normaliser and actors, all sizes bounded.

An ONNX file is a program. Before a session runs it, it is held against what `hotice export` writes: no loops or
branches, no data in other files, nothing that makes much of little.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

OPERATIONS = (
    *("Add", "Sub", "Mul", "Div", "Sqrt", "Reciprocal", "Clip", "Min", "Max"),
    *("Gemm", "MatMul", "Concat", "Identity", "Elu", "Relu", "Tanh", "Sigmoid"),
)
"""Row by row, or along a row: as many rows come out as go in."""
MOST_NODES = 200
MOST_WIDTH = 65_536
"""Numbers in a row."""
FLOAT, FLOAT_BYTES = 1, 4
"""Number of single precision among ONNX's types, and its size."""
ALONG_ROW = (1, -1)


def graph_fault(model: Any, inputs: tuple[str, int], outputs: tuple[str, int]) -> str:
    """Anything that an `onnx.ModelProto` has and no exported policy would, in words; "" for a sound one.

    inputs, outputs: name and width of the one input and the one output, both (rows, width) in single precision.
    """
    graph = model.graph
    if model.functions or model.training_info or graph.sparse_initializer:
        return "has functions, training or sparse tensors"
    if len(graph.node) > MOST_NODES:
        return f"has {len(graph.node):,} operations: at most {MOST_NODES} are run"
    for node in graph.node:
        if node.op_type not in OPERATIONS or node.domain not in ("", "ai.onnx"):
            return f"has operation {node.domain + node.op_type!r}: known are {', '.join(OPERATIONS)}"
        if any(a.HasField("g") or a.graphs or a.HasField("t") or a.tensors for a in node.attribute):
            return f"has a graph or tensor within operation {node.op_type!r}"
        if node.op_type == "Concat" and [a.i for a in node.attribute if a.name == "axis" and a.i in ALONG_ROW] == []:
            return "joins rows, not what is in them (Concat)"
    return next(_ports(graph, inputs, outputs), "") or next(_tensors(graph), "") or _widths(model)


def _ports(graph: Any, inputs: tuple[str, int], outputs: tuple[str, int]) -> Iterator[str]:
    stored = {tensor.name for tensor in graph.initializer}
    for kind, ports, (name, width) in (
        ("input", [p for p in graph.input if p.name not in stored], inputs),
        ("output", list(graph.output), outputs),
    ):
        if [p.name for p in ports] != [name]:
            yield f"has {kind}s {', '.join(repr(p.name[:60]) for p in ports[:5]) or 'none'}: {name!r} is needed"
            return
        tensor = ports[0].type.tensor_type
        sizes = [d.dim_value for d in tensor.shape.dim]
        if tensor.elem_type != FLOAT or len(sizes) != 2 or sizes[1] != width:
            yield f"{kind} {name!r} is no row of {width} numbers in single precision"


def _tensors(graph: Any) -> Iterator[str]:
    import math

    for tensor in graph.initializer:
        sizes = list(tensor.dims)
        if tensor.external_data or tensor.data_location:
            yield f"tensor {tensor.name[:60]!r} lies in another file"
        elif len(sizes) > 2 or not all(0 < n <= MOST_WIDTH for n in sizes):
            yield f"tensor {tensor.name[:60]!r} is of an impossible size"
        elif tensor.data_type != FLOAT or len(tensor.raw_data) not in (0, FLOAT_BYTES * math.prod(sizes)):
            yield f"tensor {tensor.name[:60]!r} is not of single precision, or not whole"
        elif not tensor.raw_data and len(tensor.float_data) != math.prod(sizes):
            yield f"tensor {tensor.name[:60]!r} is not whole"


def _widths(model: Any) -> str:
    import onnx

    try:
        graph = onnx.shape_inference.infer_shapes(model, check_type=True, strict_mode=True).graph
    except (onnx.shape_inference.InferenceError, ValueError, RuntimeError, TypeError) as error:
        return f"its operations do not fit together: {' '.join(str(error).split())[:200]}"
    known = {value.name: value.type.tensor_type for value in (*graph.value_info, *graph.input, *graph.output)}
    for name in (name for node in graph.node for name in node.output):
        sizes = list(known[name].shape.dim) if name in known and known[name].HasField("shape") else None
        if sizes is None or len(sizes) > 2 or any(d.dim_value > MOST_WIDTH for d in sizes):
            return f"value {name[:60]!r} is of unknown or impossible size"
        if sizes and not sizes[-1].dim_value:
            return f"value {name[:60]!r} is of unknown width"
    return ""
