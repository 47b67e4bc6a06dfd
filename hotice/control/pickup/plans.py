"""Choice of the plan to follow: one made ahead, as long as feet and object are where it has them; else a new one.

Making a plan takes longer than a control step, and the torques of the last step go on meanwhile. The first plan is
therefore made before the first step, while the robot stands; in a step one is made only for an object that has moved
since.
"""

from __future__ import annotations

from hotice.control.controller import Measurement
from hotice.control.pick_plan import PickPlan, Planner
from hotice.control.pickup.memory import PickupMemory
from hotice.errors import PickInfeasible


class Plans:
    """Plans of one planner, kept in the memory of the pick-up."""

    def __init__(self, planner: Planner) -> None:
        self.planner = planner

    def foresee(self, memory: PickupMemory, m: Measurement) -> None:
        """Plan for the object as seen before the first step, kept in `memory.plan`.

        If no plan exists, `memory.plan` stays None and `choose` reports why when the motion begins.
        """
        try:
            memory.plan = self._plan(memory, m)
        except PickInfeasible:
            memory.plan = None

    def choose(self, memory: PickupMemory, m: Measurement) -> str:
        """Leaves the plan to set out with in `memory`; returns why there is none, or nothing."""
        try:
            memory.plan = self._plan(memory, m)
            return ""
        except PickInfeasible as error:
            return str(error)

    def _plan(self, memory: PickupMemory, m: Measurement) -> PickPlan:
        if m.p_WO is None or m.quat_WO is None:
            raise PickInfeasible("the object is not seen")
        if memory.plan is not None and self.planner.fits(memory.plan, memory.start, m.p_WO, m.quat_WO):
            return memory.plan
        return self.planner.plan(memory.start, m.p_WO, m.quat_WO)
