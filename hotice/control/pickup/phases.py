"""Phases of a pick-up: what each asks of the robot, when it ends and what follows.

A plan made ahead is followed as long as feet and object are where it has them; else a new one is made. Making one
takes longer than a control step, and the torques of the last step go on meanwhile. The first plan is therefore made
before the first step, while the robot stands; in a step one is made only for an object that has moved since.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hotice.control.controller import Measurement
from hotice.control.pick_plan import PickPlan, Planner
from hotice.control.pickup import stepping
from hotice.control.pickup.config import PickupConfig
from hotice.control.pickup.footwork import Departure
from hotice.control.pickup.machine import Machine
from hotice.control.pickup.memory import Motion, PickupMemory
from hotice.control.whole_body.terms import HANDS, Terms
from hotice.errors import PickInfeasible

Array = NDArray[np.float64]
HOLDING = ("lift", "back", "retreat", "depart", "hold")
FIRST_SQUEEZE_N, FIRST_SQUEEZE_N_PER_S = 25.0, 20.0  # while the hands look for the object


class Phases(Machine):
    """The phase machine; `true`: terms of the measured state, `ref`: terms of the last reference."""

    def __init__(
        self, config: PickupConfig, planner: Planner, departure: Departure, squeeze_n: float, true: Terms, ref: Terms
    ) -> None:
        self.config, self.planner, self.departure, self.squeeze_n = config, planner, departure, squeeze_n
        super().__init__(config.rate_hz, true, ref)
        self._carried = planner.carried

    def foresee(self, memory: PickupMemory, m: Measurement) -> None:
        """Plan for the object as seen before the first step; if there is none, `memory.plan` stays None.

        The reason is reported when the motion begins.
        """
        try:
            memory.plan = self._plan_for(memory, m)
        except PickInfeasible:
            memory.plan = None

    def watch(self, memory: PickupMemory, m: Measurement) -> None:
        """Notices an object that is lost."""
        if memory.phase not in HOLDING or not self.lost(memory, m, self.config.hold_n, self.config.lost_s):
            return
        memory.failure = f"lost the object in {memory.phase}"
        memory.plan = replace(_plan(memory), to_crouch=memory.reference[None], to_pregrasp=memory.reference[None])
        self.enter(memory, m, "open", memory.failure)

    def _settle(self, memory: PickupMemory, m: Measurement, motion: Motion, elapsed: float) -> None:
        if elapsed >= self.config.settle_s:
            self._begin(memory, m)

    def _crouch(self, memory: PickupMemory, m: Measurement, motion: Motion, elapsed: float) -> None:
        plan = _plan(memory)
        # the path begins where the robot stood at first
        knots = [plan.crouch] if memory.attempt else plan.to_crouch[1:]
        memory.reference = self.along([memory.came_from, *knots], elapsed / self.config.crouch_s)
        if elapsed >= self.config.crouch_s:
            self.enter(memory, m, "reach")

    def _reach(self, memory: PickupMemory, m: Measurement, motion: Motion, elapsed: float) -> None:
        memory.reference = self.along(_plan(memory).to_pregrasp, elapsed / self.config.reach_s)
        if elapsed >= self.config.reach_s:
            memory.attempt += 1
            self.enter(memory, m, "close")

    def _close(self, memory: PickupMemory, m: Measurement, motion: Motion, elapsed: float) -> None:
        c, plan = self.config, _plan(memory)
        memory.reference = self.along(plan.to_grasp, elapsed / c.close_s)
        pressed = elapsed - 0.7 * c.close_s
        memory.squeeze_n = float(np.clip(FIRST_SQUEEZE_N_PER_S * pressed, 0.0, FIRST_SQUEEZE_N))
        if elapsed >= 0.7 * c.close_s and self.feels(m, c.touch_n):
            memory.came_from = memory.reference
            self.enter(memory, m, "squeeze")
        elif elapsed >= c.close_s + c.touch_s:
            self._missed(memory, m, "hands felt nothing")

    def _squeeze(self, memory: PickupMemory, m: Measurement, motion: Motion, elapsed: float) -> None:
        share, first = min(elapsed / self.config.squeeze_s, 1.0), FIRST_SQUEEZE_N
        memory.reference = self.along([memory.came_from, _plan(memory).grasp], 2.0 * share)
        if share == 0:
            memory.squeeze_n = max(memory.squeeze_n, first)
        else:
            memory.squeeze_n = first + (self.squeeze_n - first) * min(2 * share, 1)
        memory.load_share = max(2.0 * share - 1.0, 0.0)
        if elapsed >= self.config.squeeze_s:
            if self.feels(m, 0.4 * self.squeeze_n):
                memory.object_z_m = self._object_z(m)
                self.enter(memory, m, "lift")
            else:
                self._missed(memory, m, "hands could not squeeze")

    def _lift(self, memory: PickupMemory, m: Measurement, motion: Motion, elapsed: float) -> None:
        c, plan = self.config, _plan(memory)
        memory.load_share = 1.0
        memory.reference = self.along(plan.retreat[: plan.lift_knots + 1], elapsed / c.lift_s)
        if elapsed < c.lift_s:
            return
        risen, planned = self._object_z(m) - memory.object_z_m, self.planner.rise_m
        if risen < c.risen_share * planned:
            self._missed(memory, m, f"object rose {100 * risen:.0f} of {100 * planned:.0f} cm")
        elif plan.back_m > 0.0:
            self._step_off(memory, m, "back", Departure(back_m=plan.back_m))
        else:
            self.enter(memory, m, "retreat")

    def _back(self, memory: PickupMemory, m: Measurement, motion: Motion, elapsed: float) -> None:
        if stepping.go_on(memory, m, motion, elapsed):
            memory.shift_m = -_plan(memory).back_m
            self.enter(memory, m, "retreat")

    def _retreat(self, memory: PickupMemory, m: Measurement, motion: Motion, elapsed: float) -> None:
        plan = _plan(memory)
        memory.reference = self.along(plan.retreat[plan.lift_knots :], elapsed / self.config.retreat_s)
        memory.reference[0] += memory.shift_m
        if elapsed < self.config.retreat_s:
            return
        rest = replace(self.departure, back_m=max(self.departure.back_m - plan.back_m, 0.0))
        if rest.stances():
            self._step_off(memory, m, "depart", rest)
        else:
            self.enter(memory, m, "hold")

    def _depart(self, memory: PickupMemory, m: Measurement, motion: Motion, elapsed: float) -> None:
        if stepping.go_on(memory, m, motion, elapsed):
            self.enter(memory, m, "hold")

    def _open(self, memory: PickupMemory, m: Measurement, motion: Motion, elapsed: float) -> None:
        plan = _plan(memory)
        memory.squeeze_n = memory.load_share = 0.0
        memory.reference = self.along([memory.came_from, plan.pregrasp, plan.crouch], elapsed / self.config.open_s)
        if elapsed >= self.config.open_s:
            if memory.failure:
                self.enter(memory, m, "stand")
            else:
                self._begin(memory, m)

    def _stand(self, memory: PickupMemory, m: Measurement, motion: Motion, elapsed: float) -> None:
        memory.reference = self.along([memory.came_from, memory.start], elapsed / self.config.stand_s)
        if elapsed >= self.config.stand_s:
            self.enter(memory, m, "abort")

    def _object_z(self, m: Measurement) -> float:
        """Height of the object [m]; where it is not seen, that between the hands."""
        if m.p_WO is None:
            return float(self._true.p_WF[HANDS, 2].mean()) - self.planner.above_m
        return float(m.p_WO[2])

    def _begin(self, memory: PickupMemory, m: Measurement) -> None:
        try:
            memory.plan, memory.failure = self._plan_for(memory, m), ""
        except PickInfeasible as error:
            memory.failure = str(error)
        self.enter(memory, m, "stand" if memory.failure else "crouch", memory.failure)

    def _plan_for(self, memory: PickupMemory, m: Measurement) -> PickPlan:
        """The plan that is there, if it fits what is seen, else a new one. Raises `PickInfeasible`."""
        if m.p_WO is None or m.quat_WO is None:
            raise PickInfeasible("the object is not seen")
        if memory.plan is not None and self.planner.fits(memory.plan, memory.start, m.p_WO, m.quat_WO):
            return memory.plan
        return self.planner.plan(memory.start, m.p_WO, m.quat_WO)

    def _missed(self, memory: PickupMemory, m: Measurement, why: str) -> None:
        if memory.attempt >= self.config.attempts:
            memory.failure = why
        self.enter(memory, m, "open", why)

    def _step_off(self, memory: PickupMemory, m: Measurement, phase: str, departure: Departure) -> None:
        self.enter(memory, m, phase)
        stepping.begin(memory, self._true, self._ref, self._carried.mass_kg, departure)


def _plan(memory: PickupMemory) -> Any:
    """The plan, which is there from `crouch` on."""
    return memory.plan


Phases.STEPS = {
    "settle": Phases._settle,
    "crouch": Phases._crouch,
    "reach": Phases._reach,
    "close": Phases._close,
    "squeeze": Phases._squeeze,
    "lift": Phases._lift,
    "back": Phases._back,
    "retreat": Phases._retreat,
    "depart": Phases._depart,
    "hold": Phases.rest,
    "open": Phases._open,
    "stand": Phases._stand,
    "abort": Phases.rest,
}
PHASES = tuple(Phases.STEPS)
