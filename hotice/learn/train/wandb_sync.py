"""Weights & Biases, where it is asked for: it follows what TensorBoard writes."""

from __future__ import annotations

import importlib.util
from typing import Any

from hotice.errors import MissingExtra, OutputError
from hotice.learn.train.config import TrainConfig, config_to_dict


def check_wandb(config: TrainConfig) -> None:
    """Raises `MissingExtra` where a project is given and the package is not there: before anything is built."""
    if config.wandb is not None and importlib.util.find_spec("wandb") is None:
        raise MissingExtra("--wandb", "wandb", "wandb")


def wandb_run(config: TrainConfig) -> Any | None:
    """A run whose `finish` is to be called, or None where no project is given.

    A run that goes on is a new one there, of the same group. Raises `OutputError` where none can be begun.
    """
    if config.wandb is None:
        return None
    import wandb  # type: ignore[import-not-found]

    try:
        return wandb.init(
            project=config.wandb,
            name=config.out.name,
            group=str(config.out),
            dir=str(config.out),
            config=config_to_dict(config),
            sync_tensorboard=True,
        )
    except wandb.Error as error:
        raise OutputError(f"no run of Weights & Biases in project {config.wandb}: {error}") from None
