"""Health check after every update, before anything is saved: finite networks, few diverged environments."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import torch
from torch import Tensor, nn

from hotice.errors import CheckpointError, DivergedError, SimulationError
from hotice.learn.checkpoints.average import PREFIX

MANY = 0.5
"""Share of the environments that may diverge in one update; when physics is sound, next to none does."""
FEW = 4
"""This many diverged environments are always tolerated."""


def first_not_finite(tensors: Mapping[str, Tensor]) -> str | None:
    """Name of a tensor that holds NaN or an infinity; None when all are finite."""
    floats = {name: t for name, t in tensors.items() if t.is_floating_point()}
    if not floats or bool(torch.stack([t.isfinite().all() for t in floats.values()]).all()):
        return None
    return next(name for name, t in floats.items() if not t.isfinite().all())


def check_network(net: nn.Module, update: int, run: Path) -> None:
    """Raises `DivergedError` when weights or normalisers are not finite: the run ends before they are saved."""
    name = first_not_finite(net.state_dict())
    if name is not None:
        raise DivergedError(
            f"{name} is not finite after update {update}: the last checkpoint in {run} is from before; lower "
            "--max-learning-rate and go on from there with --resume"
        )


def check_physics(diverged: int, num_envs: int, update: int, run: Path) -> None:
    """Raises `SimulationError` when so many simulations diverged during update `update` that nothing can be learnt."""
    if diverged > max(FEW, MANY * num_envs):
        raise SimulationError(
            f"simulations diverged {diverged:,} times in {num_envs:,} environments during update {update} (an action "
            "that is not finite counts as one): lower --physics-dt-s, --leg-scale-rad or --action-limit; the last "
            f"checkpoint in {run} is kept"
        )


def check_weights(path: Path, tensors: Mapping[str, Tensor]) -> None:
    """Raises `CheckpointError` when networks, or their average, among the tensors of a checkpoint are not finite."""
    weights = {k.removeprefix("net."): v for k, v in tensors.items() if k.startswith(("net.", PREFIX))}
    name = first_not_finite(weights)
    if name is not None:
        raise CheckpointError(f"{path}: {name} is not finite: the run had diverged, take an older checkpoint")
