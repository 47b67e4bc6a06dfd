"""Walks of the newest checkpoint of a run, in some of the run's scenes."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import torch

from hotice.documents import read_json
from hotice.errors import InvalidConfig
from hotice.evaluate.conditions import Conditions
from hotice.evaluate.record import record_rollouts
from hotice.learn.checkpoints.checkpoint import list_checkpoints
from hotice.learn.policy import load_policy
from hotice.model.object_range import ObjectRange
from hotice.model.scene import Scene
from hotice.model.shipped import resolve_scenes
from hotice.replay import RolloutRecord
from hotice.sim.carry_bank import CarryBank

CONFIG = "config.json"
MOST_BYTES = 2**20


class NewestWalks:
    """`scenes`: those that are walked, the same ones for each checkpoint. `seen`: the newest that walked, or None."""

    def __init__(self, run: Path, rollouts: int, seed: int) -> None:
        """Reads the run's configuration. Raises `HoticeError`: it is missing or none, or of pick-ups."""
        self._run, self._seed = run, seed
        asked, perturbed = _read(run / CONFIG)
        self._conditions = Conditions(perturbed=perturbed)
        found = resolve_scenes(asked)
        chosen = np.random.default_rng(seed).permutation(len(found))[:rollouts]
        self.scenes: list[Scene] = [found[i] for i in sorted(chosen.tolist())]
        self._bank: CarryBank | None = None
        self.seen: Path | None = None

    def newest(self) -> Path | None:
        """The newest checkpoint, None while there is none."""
        return next(reversed(list_checkpoints(self._run)), None)

    def walk(self, checkpoint: Path) -> Iterator[RolloutRecord]:
        """One walk in each scene. Raises `HoticeError`: a checkpoint that is not whole, or was removed meanwhile."""
        self.seen = checkpoint
        policy = load_policy(checkpoint, threads=1)
        if self._bank is None:
            cpu = torch.device("cpu")
            self._bank = CarryBank.sample(ObjectRange(), len(self.scenes), self._seed, 0.005, cpu)
        for scene, state in zip(self.scenes, self._bank.states, strict=True):
            yield from record_rollouts(policy, scene, [state], self._conditions, seed=self._seed, threads=1)


def _read(path: Path) -> tuple[list[str], bool]:
    """Scenes of a run, and whether it is perturbed."""
    content = read_json(path, MOST_BYTES, InvalidConfig)
    scenes = content.get("scenes") if isinstance(content, dict) else None
    if not (isinstance(scenes, list) and scenes and all(isinstance(item, str) for item in scenes)):
        raise InvalidConfig(f"{path}: is no configuration of a run: it names no scenes")
    if "picks" in content:
        raise InvalidConfig(f"{path}: is of pick-ups, which are not watched: score them by `hotice pickup evaluate`")
    return scenes, content.get("perturbed") is True
