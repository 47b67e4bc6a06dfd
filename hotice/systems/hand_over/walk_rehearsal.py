"""Trying the walking baseline in simulation from the very state in which it would take over, before it does."""

from __future__ import annotations

import copy

import numpy as np
from numpy.typing import NDArray

from hotice.systems.hand_over.stage import VERDICTS, RehearsalStage
from hotice.systems.setup.rehearsal_config import RehearsalConfig
from hotice.systems.setup.setup import StationSetup

Array = NDArray[np.float64]


class WalkRehearsal:
    """Trial of the walk, planned from a robot state, in the station's model, on the true state like the station's walk.

    Called with a robot state (84,); returns an index into `VERDICTS`, the first failure among the tries. `stage`: its
    model.
    """

    def __init__(self, setup: StationSetup, config: RehearsalConfig | None = None) -> None:
        self.config = config or RehearsalConfig()
        self._setup, self.stage = setup, RehearsalStage(setup)

    def __call__(self, state: Array) -> int:
        from hotice.control.plant import TorquePlant
        from hotice.control.walk.later import WalkLater

        plant = TorquePlant(copy.copy(self.stage.model))
        walk = WalkLater(self._setup.pf, self._setup.carry)
        plant.reset(*self.stage.start(state, 0.0))
        memory = walk.start(plant.measure())
        if memory.controller is None:
            return VERDICTS.index("no_way")
        substeps = max(1, round(1.0 / walk.rate_hz / self._setup.physics_dt_s))
        for push in self.config.push_m_s:
            plant.reset(*self.stage.start(state, push))
            now = memory
            while plant.data.time < self.config.horizon_s:
                command, now = walk.step(now, plant.measure())
                plant.step(command.torque, substeps)
                verdict = self.stage.verdict(plant.data)
                if verdict:
                    return verdict
        return 0
