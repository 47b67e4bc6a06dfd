"""Senses of the simulated robot: noise and a late reading as students are trained under, or the truth."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hotice.model.objects import CarriedObject
from hotice.policy import Percept, PerceptModel
from hotice.policy.measuring import DRAWS, ESTIMATE, measure
from hotice.task.sensing import TRACK_TILT, SensingConfig, draw_delays, reads_late

Array = NDArray[np.float64]


class Senses:
    """Percepts of one walk, one a control step, in the order in which it is walked.

    As `hotice.systems.sensor_model` measures in a diagram.

    Args:
        carried: the object.
        config: noise and delays; `SensingConfig()`: none.
        control_dt_s: between two percepts [s].
        substeps: physics steps of a control step.
        seed: of the noise and of the delays, which are drawn for the walk.

    Attributes:
        delay: physics steps before an action reaches the motors.
    """

    def __init__(
        self, carried: CarriedObject, config: SensingConfig, control_dt_s: float, substeps: int, seed: int
    ) -> None:
        self._true, self._config, self._dt_s = PerceptModel(carried), config, control_dt_s
        self._rng = np.random.default_rng([seed, 1])
        self._late, delay_s = draw_delays(config, control_dt_s, substeps, seed)
        self.delay = round(delay_s / control_dt_s * substeps)
        self._hold, self._gain = config.hold_steps(control_dt_s), config.object_gain(control_dt_s)
        self._estimate, self._count = np.zeros(ESTIMATE), 0
        self._last: Percept | None = None

    def measure(self, qpos: Array, qvel: Array) -> Percept:
        """What is sensed of the true state, qpos (43,) and qvel (41,) of all 29 joints."""
        true = self._true(qpos, qvel)
        if self._config.exact:
            return true
        percept, self._estimate = measure(
            true,
            self._estimate,
            self._rng.uniform(-1.0, 1.0, DRAWS),
            self._config,
            self._true.carried.keypoints_world_aligned,
            keypoints=self._true.keypoints_at(qpos),
            refresh=self._count % self._hold == 0,
            gain=max(self._gain, 1.0 / (self._count + 1)),
            tilt_gain=max(TRACK_TILT, 1.0 / (self._count + 1)),
            hold_s=self._hold * self._dt_s,
            dt_s=self._dt_s if self._count else 0.0,
        )
        self._count += 1
        before, self._last = self._last, percept
        return before if before is not None and reads_late(self._late, self._count) else percept
