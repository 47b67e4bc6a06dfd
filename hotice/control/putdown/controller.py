"""The controller of a put-down: the plan of a pick-up from there, run backwards."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hotice.control.controller import Measurement
from hotice.control.pick_plan import Planner, Support
from hotice.control.pickup import PickupMemory, Stance, stepping
from hotice.control.pickup.config import squeeze_of
from hotice.control.pickup.phased import Phased, configuration
from hotice.control.pickup.tracking import Tracking
from hotice.control.putdown.config import PutDownConfig
from hotice.control.putdown.phases import Phases
from hotice.control.whole_body.qp import QpConfig, WholeBodyQp
from hotice.control.whole_body.terms import Terms
from hotice.errors import PickInfeasible, PutDownInfeasible
from hotice.model.objects import CarriedObject

Array = NDArray[np.float64]
NEAR_BY_M = 1.0
"""Farthest stance from which the robot steps to the support."""


class PutDown(Phased):
    """The controller; see `hotice.control.controller.Controller`.

    Args:
        carried: the object, in the robot's hands when it starts. support: what it comes to stand on, seen from G.
        p_GO, quat_GO: where it is to stand, (3,) [m] and (4,) wxyz, in G.
        stance: G in W, where the robot is to stand when it lowers the object.
        grasp_above_m: how it is held, `Grip.above_m` of the pick-up; None: as it would be picked up from there.
        config, qp: parameters.

    Raises:
        CarryInfeasible: the object is too heavy, wide or deep to be held.
        PutDownInfeasible: it cannot be put down there.
    """

    def __init__(
        self,
        carried: CarriedObject,
        support: Support,
        p_GO: ArrayLike,
        quat_GO: ArrayLike,
        *,
        stance: Stance | None = None,
        grasp_above_m: float | None = None,
        config: PutDownConfig | None = None,
        qp: QpConfig | None = None,
    ) -> None:
        self.config = config or PutDownConfig()
        self.carried, self.support, self.stance = carried, support, stance or Stance()
        self.planner = Planner(carried, support, self.config.durations, grasp_above_m=grasp_above_m)
        try:
            self.plan = self.planner.plan(self.planner.start_q, p_GO, quat_GO)
        except PickInfeasible as error:
            raise PutDownInfeasible(
                f"the {carried.shape} cannot be put down on a support {support.top_m:.2f} m high, {support.near_m:.2f} "
                f"m ahead: a pick-up from there, run backwards, has no plan: {error}"
            ) from None
        self.squeeze_n = squeeze_of(self.config.squeeze_n, carried.mass_kg)
        self._qp = WholeBodyQp(self.planner.wrist_pos, qp)
        self._ref = ref = Terms(self.planner.wrist_pos)
        ref.q[:] = self.planner.start_q
        ref.refresh()
        feet, true = stepping.ankles(ref), self._qp.terms
        self._phases = Phases(self.config, self.plan, carried.mass_kg, self.squeeze_n, feet, true, ref)
        self._tracking = Tracking(carried, self.squeeze_n, true, ref)

    @property
    def rate_hz(self) -> float:
        """Control rate."""
        return self.config.rate_hz

    def start(self, measurement: Measurement) -> PickupMemory:
        """Memory before the first step, of a robot that stands near the support with the object in its hands."""
        q = self.plan.retreat[-1]
        memory = PickupMemory(
            qp=self._qp.start(measurement),
            stance=None,
            phase="settle",
            since_s=measurement.time_s,
            came_from=q,
            reference=q,
            start=q,
            plan=self.plan,
            squeeze_n=self.squeeze_n,
            load_share=1.0,
        )
        return self.placed(memory, measurement) if measurement.finite() else memory

    def placed(self, memory: PickupMemory, measurement: Measurement) -> PickupMemory:
        """The memory of a robot that stands where it is measured: its centre of mass is to come over its feet.

        One that is too far from the support keeps standing, with the reason in `failure`.
        """
        q = configuration(self.stance.measurement(measurement))
        ref, here = self._ref, Stance.of(self._ref, q)
        shift = np.zeros(3)
        shift[:2] = [here.x, here.y] - stepping.com_with(ref, self.carried.mass_kg)
        memory = replace(memory, stance=self.stance, came_from=q, reference=q, start=q, shift=shift)
        if np.hypot(here.x, here.y) > NEAR_BY_M:
            memory.phase = "done"
            memory.failure = (
                f"the robot stands {np.hypot(here.x, here.y):.2f} m from where it is to put the object down: at most "
                f"{NEAR_BY_M:g} m is allowed, walk there first"
            )
        return memory
