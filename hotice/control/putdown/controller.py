"""The controller of a put-down: the plan of a pick-up from there, run backwards."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hotice.control.controller import Measurement
from hotice.control.pick_plan import Planner, Support
from hotice.control.pickup import PickupMemory, Stance, stepping
from hotice.control.pickup.config import squeeze_of
from hotice.control.pickup.footwork import SOLE_AHEAD_M
from hotice.control.pickup.phased import Phased, configuration
from hotice.control.pickup.tracking import Tracking
from hotice.control.putdown.config import PutDownConfig
from hotice.control.putdown.phases import Phases, planted
from hotice.control.whole_body.qp import QpConfig, WholeBodyQp
from hotice.control.whole_body.terms import FEET, PELVIS, Terms
from hotice.errors import PickInfeasible, PutDownInfeasible
from hotice.model.frames import GRAVITY
from hotice.model.objects import CarriedObject

Array = NDArray[np.float64]
NEAR_BY_M = 1.0
"""Farthest stance from which the robot steps to the support."""
LEAST_AIR_M = 0.003
PELVIS_RAD_S = 12.0
"""Of the pelvis' task; that of a pick-up, 7, let a robot whose torso's centre of mass is off lean by 15 degrees more
than planned, over a support 0.48 m high beyond the 60 degrees that count as a fall."""
CATCH_M, ASIDE, REST_M, APART_M = 0.05, 0.3, 0.06, (0.12, 0.42)
SPIN_RAD_S, SINK_M_S, LEAST_UP = 1.8, 0.4, 0.95
"""A marching robot is taken over with its foot so low, so near to rest aside (as a share of the feet's distance) and
ahead, its feet so far apart, so slow and upright. Of 34 instants of a march, taken over at random, all 16 with a foot
higher than 8 cm fell, and none of the other 18 before it stood."""


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
        self._floor_m = feet[:, 2]
        self._phases = Phases(self.config, self.plan, carried.mass_kg, self.squeeze_n, feet, true, ref)
        self._tracking = Tracking(carried, self.squeeze_n, true, ref)
        self._tracking.targets.gain_frame("pelvis", [0.0, 0.0, 20.0, 10.0, 10.0, 10.0], PELVIS_RAD_S)

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
            phase="catch",
            since_s=measurement.time_s,
            came_from=q,
            reference=q,
            start=q,
            plan=self.plan,
            squeeze_n=self.squeeze_n,
            load_share=1.0,
        )
        return self.placed(memory, measurement) if measurement.finite() else memory

    def catches(self, measurement: Measurement) -> bool:
        """Whether it can begin now: a robot that stands, or marches so that its next step would end it.

        A foot in the air comes down and is no higher than `CATCH_M`, the point in which the robot would come to rest is
        between its feet, and it neither leans nor turns nor falls fast.
        """
        if not measurement.finite():
            return False
        t, load_kg = self._ref, self.carried.mass_kg
        t.update(measurement)
        feet, com = stepping.ankles(t), stepping.com_with(t, load_kg)
        rest = com + t.v_com[:2] * np.sqrt(t.com[2] / GRAVITY)
        soles = feet[:, :2] + SOLE_AHEAD_M * np.column_stack([np.cos(feet[:, 3]), np.sin(feet[:, 3])])
        above = feet[:, 2] - self._floor_m
        across = soles[0] - soles[1]
        apart = max(float(np.linalg.norm(across)), 1e-6)
        aside, ahead = across / apart, np.array([across[1], -across[0]]) / apart
        off = rest - soles.mean(axis=0)
        return bool(
            above.max() <= CATCH_M
            and not ((above > LEAST_AIR_M) & (t.v_WF[FEET, 2] > 0.0)).any()
            and abs(off @ aside) <= ASIDE * apart
            and abs(off @ ahead) <= REST_M
            and APART_M[0] <= apart <= APART_M[1]
            and np.linalg.norm(measurement.w_WP_P) <= SPIN_RAD_S
            and measurement.v_WP[2] >= -SINK_M_S
            and t.R_WF[PELVIS, 2, 2] >= LEAST_UP
        )

    def placed(self, memory: PickupMemory, measurement: Measurement) -> PickupMemory:
        """The memory of a robot that stands, or marches, where it is measured; a foot in the air comes down first.

        One that is too far from the support keeps standing, with the reason in `failure`.
        """
        q = configuration(self.stance.measurement(measurement))
        here = Stance.of(self._ref, q)
        feet, floor_m = stepping.ankles(self._ref), self._floor_m
        air = ~planted(measurement, feet[:, 2] - floor_m)
        # one that feels nothing although both do not stands, as in a state before the first step of the simulation
        air &= feet[:, 2] - floor_m > LEAST_AIR_M
        memory = replace(memory, stance=self.stance, came_from=q, reference=q, start=q, feet=feet, air=air)
        if np.hypot(here.x, here.y) > NEAR_BY_M:
            memory.phase = "done"
            memory.failure = (
                f"the robot stands {np.hypot(here.x, here.y):.2f} m from where it is to put the object down: at most "
                f"{NEAR_BY_M:g} m is allowed, walk there first"
            )
        return memory
