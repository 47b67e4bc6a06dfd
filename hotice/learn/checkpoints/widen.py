"""Networks for an observation with more rows than they were trained on: the new inputs begin with zero weights."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from hotice.task import history

Layout = Sequence[tuple[str, int]]


def columns_within(old: Layout, new: Layout) -> Tensor | None:
    """Columns of the `new` observation that those of the `old` one are, (O,); None unless all rows are there."""
    starts, at = {}, 0
    for name, width in new:
        starts[name] = (at, width)
        at += width
    if any(name not in starts or starts[name][1] != width for name, width in old):
        return None
    return torch.cat([torch.arange(width) + starts[name][0] for name, width in old])


def alike(layout: Layout) -> Tensor:
    """Column of like values for each column (D,): for the history the row of the present instant, else itself."""
    index, starts, at = [], {}, 0
    for name, width in layout:
        starts[name] = at
        index.append(torch.arange(at, at + width))
        if name == "history":
            frame = torch.cat([torch.arange(w) + starts[row] for row, w in history.ROWS])
            index[-1] = frame.repeat(width // history.FRAME)
        at += width
    return torch.cat(index)


def widen(tensors: dict[str, Tensor], old: Layout, new: Layout, norm: str, net: str) -> dict[str, Tensor]:
    """Tensors of a checkpoint for the observation `new`; the same where that does not hold all rows of the `old` one.

    First layers and their optimiser moments get zeros for the new inputs, so what the networks compute does not change.
    The normaliser gets mean 0 and variance 1, for a history those of the rows that it repeats. `norm`: the normaliser's
    name; `net`: of the part that reads it, actor or critic.
    """
    columns, size = columns_within(old, new), sum(width for _, width in new)
    if columns is None or len(columns) == size:
        return tensors
    columns = columns.to(tensors[f"net.{norm}.mean"].device)

    def placed(value: Tensor, fill: float) -> Tensor:
        out = value.new_full((*value.shape[:-1], size), fill)
        out[..., columns] = value
        return out

    wider = dict(tensors)
    like = alike(new).to(columns.device)
    for name in ("mean", "var"):
        wider[f"net.{norm}.{name}"] = placed(tensors[f"net.{norm}.{name}"], float(name == "var"))[like]
    first = [k for k in tensors if k.startswith("net.nets.") and k.endswith(f".{net}.0.weight")]
    for key in first:
        wider[key] = placed(tensors[key], 0.0)
    shapes = {tensors[key].shape for key in first}
    for key, value in tensors.items():
        if key.startswith("optimizer.") and value.shape in shapes:
            wider[key] = placed(value, 0.0)
    return wider
