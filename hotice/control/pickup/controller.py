"""The controller of a pick-up: plan, phases, tasks, torques."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hotice.control.controller import Measurement
from hotice.control.pick_plan import Planner, Support
from hotice.control.pickup.config import PickupConfig, squeeze_of
from hotice.control.pickup.footwork import Departure
from hotice.control.pickup.memory import PickupMemory
from hotice.control.pickup.phased import Phased, configuration
from hotice.control.pickup.phases import Phases
from hotice.control.pickup.stance import Stance
from hotice.control.pickup.tracking import Tracking
from hotice.control.whole_body.qp import QpConfig, WholeBodyQp
from hotice.control.whole_body.terms import Terms
from hotice.model.objects import CarriedObject

Array = NDArray[np.float64]


class Pickup(Phased):
    """The controller; see `hotice.control.controller.Controller`.

    Args:
        carried: the object. support: what it stands on, seen from G, where the robot will stand.
        p_GO, quat_GO: where it is expected, (3,) [m] and (4,) wxyz, in G; `Stance` turns what is known in W.
        departure: steps that follow when the object is held in the carry state. config, qp: parameters.

    Raises:
        CarryInfeasible: the object is too heavy, wide or deep to be held. PickInfeasible: it cannot be reached there.
    """

    _phases: Phases

    def __init__(
        self,
        carried: CarriedObject,
        support: Support,
        p_GO: ArrayLike,
        quat_GO: ArrayLike,
        *,
        departure: Departure | None = None,
        config: PickupConfig | None = None,
        qp: QpConfig | None = None,
    ) -> None:
        self.config = config or PickupConfig()
        self.carried, self.support, self.departure = carried, support, departure or Departure()
        self.planner = Planner(carried, support, self.config.durations)
        self.carry = self.planner.carry
        self.start_q = self.planner.start_q
        self.expected = self.planner.plan(self.start_q, p_GO, quat_GO)
        self.squeeze_n = squeeze_of(self.config.squeeze_n, carried.mass_kg)
        self._qp = WholeBodyQp(self.planner.wrist_pos, qp)
        self._ref = ref = Terms(self.planner.wrist_pos)
        true = self._qp.terms
        self._phases = Phases(self.config, self.planner, self.departure, self.squeeze_n, true, ref)
        self._tracking = Tracking(carried, self.squeeze_n, true, ref)

    @property
    def rate_hz(self) -> float:
        """Control rate."""
        return self.config.rate_hz

    def start(self, measurement: Measurement) -> PickupMemory:
        """Memory before the first step, of a robot that stands in front of the object.

        Plans where the object is not where it was expected: this takes longer than a control step, and is not one.
        """
        memory = PickupMemory(
            qp=self._qp.start(measurement),
            stance=None,
            phase="settle",
            since_s=measurement.time_s,
            came_from=self.start_q,
            reference=self.start_q,
            start=self.start_q,
            plan=self.expected,
        )
        return self.placed(memory, measurement) if measurement.finite() else memory

    def placed(self, memory: PickupMemory, measurement: Measurement) -> PickupMemory:
        """The memory of a robot that stands where it is measured."""
        stance = Stance.of(self._ref, configuration(measurement))
        seen = stance.measurement(measurement)
        q = configuration(seen)
        memory = replace(memory, stance=stance, came_from=q, reference=q, start=q)
        self._phases.foresee(memory, seen)
        return memory
