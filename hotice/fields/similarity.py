"""How similar scenes are in their clutter (IV, unseen scenes): mean cosine between their fields.

Both SGFs and OGFs are compared at the nodes of one grid of the given resolution over the box that the two scenes'
bounds share. The similarity of a scene to a training set is the largest over the set.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hotice.errors import InvalidConfig
from hotice.fields.hod_pf import HodPf


def scene_similarity(a: HodPf, b: HodPf, resolution_m: float | None = None) -> float:
    """Average over shared positions and both fields of the cosine between guidance vectors, in [-1, 1].

    `resolution_m`: of the comparison (default: the finer of the two, 0.04 m in the paper). Vectors shorter than 1e-9
    count as orthogonal. Raises `InvalidConfig` when the bounds share no node or the resolution is out of range.
    """
    h = min(a.grid.resolution_m, b.grid.resolution_m) if resolution_m is None else resolution_m
    if not 0.01 <= h <= 1.0:
        raise InvalidConfig(f"resolution_m is {h!r}: 0.01 to 1 m is needed to compare scenes")
    (a_low, a_high), (b_low, b_high) = np.array(a.scene.bounds_m), np.array(b.scene.bounds_m)
    low = np.maximum(a_low, b_low)
    cells = np.floor((np.minimum(a_high, b_high) - low) / h + 0.5).astype(int)
    if cells.min() < 1:
        raise InvalidConfig(f"scenes {a.scene.name!r} and {b.scene.name!r} share no grid node at resolution {h} m")
    axes = [low[i] + (np.arange(cells[i]) + 0.5) * h for i in range(3)]
    p_W = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    return float(np.mean([_mean_cosine(x.sample(p_W), y.sample(p_W)) for x, y in ((a.sgf, b.sgf), (a.ogf, b.ogf))]))


def similarity_to_set(scene: HodPf, training: Sequence[HodPf]) -> tuple[float, int]:
    """Largest similarity to a training scene, and that scene's index. Raises `InvalidConfig` for an empty set."""
    if not training:
        raise InvalidConfig("no training scenes: similarity to a set needs at least one")
    values = [scene_similarity(scene, other) for other in training]
    best = int(np.argmax(values))
    return values[best], best


def _mean_cosine(f: np.ndarray, g: np.ndarray) -> float:
    product = np.linalg.norm(f, axis=-1) * np.linalg.norm(g, axis=-1)
    return float(((f * g).sum(axis=-1) / np.maximum(product, 1e-9)).mean())
