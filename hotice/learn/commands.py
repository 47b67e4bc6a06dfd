"""The commands of `hotice`. Heavy modules are imported inside, so that `--help` is quick."""

from __future__ import annotations

import tyro

from hotice.learn.config import TrainConfig


def train(config: tyro.conf.OmitArgPrefixes[TrainConfig]) -> int:
    """Train the agents of a preset with dual PPO."""
    from hotice.learn.runner import Runner

    Runner(config).train()
    return 0


COMMANDS = {"train": train}
