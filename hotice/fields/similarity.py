"""Similarity of scenes in their clutter (IV, unseen scenes): mean cosine between their fields.

Both SGFs and OGFs are compared at the nodes of one grid of the given resolution over the box that the two scenes'
bounds share. The similarity of a scene to a training set is the largest over the set.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hotice import checks
from hotice.checks import Range
from hotice.errors import InvalidConfig
from hotice.fields.hod_pf import HodPf
from hotice.model.scene import Scene

if TYPE_CHECKING:
    from hotice.fields.bank import FieldBank

FIELDS = ("sgf", "ogf")
SMALLEST = 1e-9
"""Vectors shorter than this count as orthogonal to all others [m/s]."""
CHUNK_NODES = 65_536


def scene_similarity(a: HodPf, b: HodPf, resolution_m: float | None = None) -> float:
    """Average over shared positions and both fields of the cosine between guidance vectors, in [-1, 1].

    `resolution_m`: of the comparison (default: the finer of the two, 0.04 m in the paper). Raises `InvalidConfig` when
    the bounds share no node or the resolution is out of range.
    """
    p_W = _nodes(_shared_box(a.scene, b.scene, min(a.grid.resolution_m, b.grid.resolution_m), resolution_m))
    cosines = [
        (_unit(x.sample(p_W)) * _unit(y.sample(p_W))).sum(axis=-1).mean() for x, y in ((a.sgf, b.sgf), (a.ogf, b.ogf))
    ]
    return float(np.mean(cosines))


def similarity_matrix(
    a: Sequence[HodPf] | FieldBank,
    b: Sequence[HodPf] | FieldBank,
    resolution_m: float | None = None,
    progress: Callable[[float], None] | None = None,
) -> NDArray[np.float32]:
    """`scene_similarity` of every scene of `a` to every one of `b`, (A, B).

    All pairs that share the same nodes are compared together: each scene is sampled once and turned into unit vectors,
    chunk by chunk, and a chunk's cosines are one matrix product in float32. `progress` is told the share that is done.

    Raises:
        InvalidConfig: an empty set, bounds that share no node, or a resolution out of range.
    """
    rows, columns = _members(a), _members(b)
    pairs: dict[_Box, list[tuple[int, int]]] = {}
    for i, one in enumerate(rows):
        for j, other in enumerate(columns):
            box = _shared_box(one.scene, other.scene, min(one.resolution_m, other.resolution_m), resolution_m)
            pairs.setdefault(box, []).append((i, j))
    result = np.empty((len(rows), len(columns)), dtype=np.float32)
    done = 0
    for box, members in pairs.items():
        index = np.array(members).T
        mine, theirs = (np.unique(side) for side in index)
        p_W = _nodes(box)
        total = np.zeros((len(mine), len(theirs)))
        for start in range(0, len(p_W), CHUNK_NODES):
            part = p_W[start : start + CHUNK_NODES]
            for field in FIELDS:
                total += _units(rows, mine, field, part) @ _units(columns, theirs, field, part).T
            if progress is not None:
                progress((done + len(members) * (start + len(part)) / len(p_W)) / result.size)
        cosine = total / (len(FIELDS) * len(p_W))
        result[index[0], index[1]] = cosine[np.searchsorted(mine, index[0]), np.searchsorted(theirs, index[1])]
        done += len(members)
    return result


def similarity_to_set(
    scene: HodPf, training: Sequence[HodPf] | FieldBank, resolution_m: float | None = None
) -> tuple[float, int]:
    """Largest similarity to a training scene, and that scene's index. Raises `InvalidConfig` for an empty set."""
    values = similarity_matrix([scene], training, resolution_m)[0]
    best = int(np.argmax(values))
    return float(values[best]), best


@dataclass(frozen=True)
class _Member:
    """A scene of a set; `sample` maps the name of a field and positions (n, 3) to vectors (n, 3)."""

    scene: Scene
    resolution_m: float
    sample: Callable[[str, NDArray[np.float32]], NDArray[np.floating]]


def _members(scenes: Sequence[HodPf] | FieldBank) -> list[_Member]:
    if isinstance(scenes, Sequence):
        members = [
            _Member(pf.scene, pf.grid.resolution_m, lambda f, p, pf=pf: getattr(pf, f).sample(p)) for pf in scenes
        ]
    else:
        members = [_Member(s, scenes.volumes.resolution_m, _of_bank(scenes, i)) for i, s in enumerate(scenes.scenes)]
    if not members:
        raise InvalidConfig("no scenes: similarity needs at least one on either side")
    return members


def _of_bank(bank: FieldBank, index: int) -> Callable[[str, NDArray[np.float32]], NDArray[np.floating]]:
    import torch

    def sample(field: str, p_W: NDArray[np.float32]) -> NDArray[np.floating]:
        scene = torch.tensor([index], device=bank.device)
        return bank.sample(field, scene, torch.from_numpy(p_W).to(bank.device)[None]).force_W[0].cpu().numpy()

    return sample


_Box = tuple[tuple[float, ...], tuple[int, ...], float]
"""Lowest corner [m], cells along each axis and their size [m]."""


def _shared_box(a: Scene, b: Scene, finer_m: float, resolution_m: float | None) -> _Box:
    """Overlap of both scenes' bounds, in cells of `resolution_m` or else `finer_m`."""
    h = finer_m if resolution_m is None else resolution_m
    checks.number("resolution_m", h, Range(least=0.01, most=1, unit="m", note="to compare scenes"))
    (a_low, a_high), (b_low, b_high) = np.array(a.bounds_m), np.array(b.bounds_m)
    low = np.maximum(a_low, b_low)
    cells = np.floor((np.minimum(a_high, b_high) - low) / h + 0.5).astype(int)
    if cells.min() < 1:
        raise InvalidConfig(f"scenes {a.name!r} and {b.name!r} share no grid node at resolution {h} m")
    return tuple(low.tolist()), tuple(cells.tolist()), h


def _nodes(box: _Box) -> NDArray[np.float32]:
    """Cell centres (n, 3) in W [m]."""
    low, cells, h = box
    axes = [low[i] + (np.arange(cells[i]) + 0.5) * h for i in range(3)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3).astype(np.float32)


def _units(
    members: list[_Member], which: NDArray[np.int64], field: str, p_W: NDArray[np.float32]
) -> NDArray[np.float32]:
    """Unit vectors of one field of some members at p_W (n, 3), (members, 3 n)."""
    return np.stack([_unit(members[i].sample(field, p_W)).reshape(-1) for i in which])


def _unit(f: NDArray[np.floating]) -> NDArray[np.floating]:
    """Vectors (..., 3) of length one, zero where they are shorter than `SMALLEST`."""
    length = np.sqrt((f * f).sum(axis=-1, keepdims=True))
    return np.where(length < SMALLEST, 0.0, f / np.maximum(length, SMALLEST)).astype(f.dtype)
