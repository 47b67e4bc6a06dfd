"""Options of one branch from those of the run: a folder, a seed, a share of the cores, and a GPU of its own."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from hotice.learn.branches.config import BranchConfig
from hotice.learn.train.config import TrainConfig
from hotice.machine import usable_cores

SEED_STRIDE = 2_000_003
"""Between the seeds of two branches; not a multiple of that between two ranks."""


def branch_folder(out: Path, number: int) -> Path:
    """Folder of a branch within that of its run."""
    return out / f"branch-{number}"


def branch_seed(seed: int, number: int, again_at: int | None = None) -> int:
    """Seed of a branch; `again_at`: the update after which it is started again, with other draws than the first time.

    That of branch 0 is the run's: alone it trains what one process would.
    """
    return seed + SEED_STRIDE * number + (0 if again_at is None else 1 + again_at)


def first_config(config: TrainConfig, number: int) -> TrainConfig:
    """Options of a branch that begins with the run."""
    return _own(config, number, seed=branch_seed(config.seed, number), resume=False)


def resumed_config(config: TrainConfig, number: int, meta: dict[str, Any]) -> TrainConfig:
    """Options of a branch that goes on from its own checkpoint of `meta`."""
    return _own(config, number, seed=int(meta["config"]["seed"]), resume=True, init=None)


def anew_config(config: TrainConfig, number: int, average: Path, update: int) -> TrainConfig:
    """Options of a branch that has no state of its own and will begin from an average, now that of `update`."""
    return _own(config, number, seed=branch_seed(config.seed, number, update), resume=False, init=average)


def _own(config: TrainConfig, number: int, **changes: Any) -> TrainConfig:
    count = config.split.branches
    return replace(
        config,
        out=branch_folder(config.out, number),
        split=BranchConfig(),
        threads=config.threads or (max(1, usable_cores() // count) if count > 1 else 0),
        device=_device(config, number),
        max_minutes=0.0,
        trials=0,
        wandb=None,
        view=False,
        view_port=0,
        **changes,
    )


def _device(config: TrainConfig, number: int) -> str:
    """Device of a branch: GPUs of a machine are shared out, one after another."""
    device = config.torch_device()
    if device != "cuda":
        return device
    import torch

    count = torch.cuda.device_count()
    return f"cuda:{number % count}" if count > 1 else device
