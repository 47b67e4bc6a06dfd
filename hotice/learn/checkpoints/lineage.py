"""Lineage of a checkpoint: the environment steps of every checkpoint that its weights or labels come from."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

ANCESTORS, MERGED = "ancestors", "merged"
BRANCHES = "branches"
"""Key of what averaged branches were, in a checkpoint of a run of several: a mean that training goes on from."""


def line_of(meta: Mapping[str, Any]) -> dict[str, int]:
    """Steps by SHA-256 of the tensors: of the checkpoint of `meta` and of all behind it.

    An ancestor shared by two branches is one entry, so that the sum over a merged line counts it once. Two checkpoints
    of one run are two entries: where branches began from different ones, what these share counts twice.
    """
    return {**meta.get(ANCESTORS, {}), str(meta["sha256"]): own_steps(meta)}


def total_steps(meta: Mapping[str, Any]) -> int:
    """Environment steps of the run of `meta` and of all its ancestors; checkpoints older than lines count their own."""
    return own_steps(meta) + sum(meta.get(ANCESTORS, {}).values())


def own_steps(meta: Mapping[str, Any]) -> int:
    """Environment steps of this checkpoint alone; 0 for an average, whose parts are ancestors."""
    return 0 if MERGED in meta and ANCESTORS in meta else int(meta["steps"])
