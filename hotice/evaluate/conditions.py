"""Under which conditions trials are simulated, and trials at their start.

`Conditions` is the one place where physics step, friction cones and the spread of robots, noise, delays and pushes are
decided, for policies, the walking baseline and records alike.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import torch

from hotice.evaluate.referees import STAY_S
from hotice.evaluate.seeds import TrialSeeds
from hotice.fields.bank import FieldBank
from hotice.model.carry import CarryState
from hotice.model.scene import Scene
from hotice.sim.carry_bank import CarryBank
from hotice.sim.env import TransportEnv
from hotice.task.config import TaskConfig
from hotice.task.contract import ROWS, STEP, UNITS
from hotice.task.protocols import Protocol, get_protocol
from hotice.task.rules import GOAL_M

CPU = torch.device("cpu")
KEPT = (*STEP, *UNITS, *ROWS, "swing_height_m")
"""Fields that a policy's own task decides; of the physics step and its number only the control period remains."""


@dataclass(frozen=True, kw_only=True)
class Conditions:
    """Physics, perturbation and time limit of trials. Raises `UnknownName` for a source that is none."""

    protocol: str | Protocol = "robot"
    """Physics and perturbations: a name in `hotice.task.protocols`, or a protocol of one's own."""
    perturbed: bool = True
    """Whether the perturbations act."""
    without: tuple[str, ...] = ()
    """Sources of perturbation that are switched off."""
    horizon_s: float = 5.0
    """Time limit (paper: 5 s)."""

    def __post_init__(self) -> None:
        get_protocol(self.protocol).task(TaskConfig(), without=self.without)

    @property
    def elliptic(self) -> bool:
        """Friction cones of the physics."""
        return get_protocol(self.protocol).elliptic

    @property
    def physics(self) -> str:
        """Physics in words, as reports have it."""
        return get_protocol(self.protocol).physics

    def task(self, trained: dict[str, Any]) -> TaskConfig:
        """The policy's training task as trials need it: from the scene's start, ended by fall or drop only.

        The time limit is longer than the trial's by `STAY_S`, see `hotice.evaluate.referees.afterwards`; `limit` has
        the trial's.
        """
        known = replace(TaskConfig(), **{k: trained[k] for k in KEPT if k in trained})
        known = get_protocol(self.protocol).task(known, perturbed=self.perturbed, without=self.without)
        task = replace(
            known,
            goal_radius_m=GOAL_M,
            anywhere=0.0,
            end_at_goal=False,
            collisions=False,
            tolerance_m=0.0,
            start_noise_m=0.03,
            start_yaw_noise_rad=0.1,
        )
        return replace(task, episode_s=self.horizon_s + STAY_S + 2 * task.control_dt_s)

    def limit(self, task: TaskConfig) -> int:
        """Control steps of a trial."""
        return max(1, round(self.horizon_s / task.control_dt_s))


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
    env = TransportEnv(len(states), bank, carry, preset, seed=seeds.block(first), config=task, threads=threads)
    env.restarts = False
    return env


@lru_cache(maxsize=1)
def _fields(scene: Scene, resolution_m: float, margin_m: float) -> FieldBank:
    """Fields of one scene, kept for its next block."""
    return FieldBank.build([scene], resolution_m, margin_m, workers=1)
