"""Trials at their start."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import torch

from hotice.evaluate.conditions import Conditions
from hotice.evaluate.seeds import TrialSeeds
from hotice.fields.bank import FieldBank
from hotice.model.carry import CarryState
from hotice.model.scene import Scene
from hotice.sim.carry_bank import CarryBank
from hotice.sim.env import TransportEnv

CPU = torch.device("cpu")


def start_trials(
    scene: Scene,
    states: Sequence[CarryState],
    seed: int,
    conditions: Conditions,
    *,
    first: int = 0,
    trained: dict[str, Any] | None = None,
    preset: str = "dual_hodpf",
    threads: int = 1,
) -> TransportEnv:
    """Trials `first` .. `first + len(states)` of a scene, ready for `reset`, each with its carry state and robot.

    Nothing that ends is started anew. Robots and starts depend on seed, scene, `first` and how many trials there are,
    not on who carries; `trained`: the task that a policy was trained on.
    """
    task, seeds = conditions.task(trained or {}), TrialSeeds.of(seed, scene)
    carry = CarryBank.of(
        states,
        task.physics_dt_s,
        CPU,
        scene=scene,
        elliptic=conditions.elliptic,
        dynamics=task.dynamics,
        robots=seeds.robots(first, len(states)),
    )
    bank = _fields(scene, task.resolution_m, task.margin_m)
    env = TransportEnv(
        len(states),
        bank,
        carry,
        preset,
        seed=seeds.block(first),
        config=task,
        threads=threads,
        moving=conditions.moving,
    )
    env.restarts = False
    return env


@lru_cache(maxsize=1)
def _fields(scene: Scene, resolution_m: float, margin_m: float) -> FieldBank:
    """Fields of one scene, kept for its next block."""
    return FieldBank.build([scene], resolution_m, margin_m, workers=1)
