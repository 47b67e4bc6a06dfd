"""Phases of a put-down: what each asks of the robot, when it ends and what follows."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from hotice.control.controller import Measurement
from hotice.control.pick_plan import PickPlan
from hotice.control.pickup import stepping
from hotice.control.pickup.footwork import SOLE_AHEAD_M, Feet, Goal, ease
from hotice.control.pickup.machine import Machine
from hotice.control.pickup.memory import Motion, PickupMemory
from hotice.control.putdown.config import PutDownConfig
from hotice.control.whole_body.terms import HANDS, Terms
from hotice.model import g1
from hotice.model.frames import yaw_from_quat

Array = NDArray[np.float64]
FALL_M_S, CATCH_S = 0.3, 0.6
"""Speed at which a foot in the air comes down, and the longest time for it."""
PLANTED_N, PLANTED_M = 30.0, 0.01
"""A foot stands that feels so much; where nothing is felt, one whose ankle is so near to its height on the floor."""
HOLDING = ("catch", "settle", "approach", "raise", "ahead", "adjust", "lower")
"""Phases in which a hand that feels too little has lost the object."""


class Phases(Machine):
    """The phase machine of one plan; G is where the feet are to stand when the object is lowered.

    Args:
        plan: of the pick-up that is run backwards. mass_kg: of the object. half_m: from its centre to its lowest point.
        squeeze_n: of each hand. feet: (2, 4) ankles where the plan has them: x, y, z [m], yaw [rad]; true, ref: see
            `Machine`.
    """

    def __init__(
        self,
        config: PutDownConfig,
        plan: PickPlan,
        mass_kg: float,
        squeeze_n: float,
        feet: Array,
        true: Terms,
        ref: Terms,
    ) -> None:
        super().__init__(config.rate_hz, true, ref)
        self.config, self.plan, self._mass_kg, self._squeeze_n, self._feet = config, plan, mass_kg, squeeze_n, feet
        self._carry = plan.retreat[::-1][: len(plan.retreat) - plan.lift_knots].copy()
        self._carry[:, 0] -= plan.back_m
        ref.q[:], ref.v[:] = self._carry[0], 0.0
        ref.refresh()
        self._com = stepping.com_with(ref, mass_kg)

    def watch(self, memory: PickupMemory, m: Measurement) -> None:
        """Notices an object that is lost before it stands."""
        if memory.phase in HOLDING and self.lost(memory, m, self.config.hold_n, self.config.lost_s):
            memory.failure = f"lost the object in {memory.phase}"
            self.enter(memory, m, "open", memory.failure)

    def _catch(self, memory: PickupMemory, m: Measurement, motion: Motion, elapsed: float) -> None:
        """Lowers a foot that is in the air where it is, until the floor is felt."""
        feet, (z, _) = memory.feet.copy(), self._feet[:, 2]
        feet[:, 2] = np.maximum(feet[:, 2] - FALL_M_S * elapsed, z - stepping.SEARCH_M)
        velocity = np.zeros((2, 4))
        velocity[:, 2] = np.where(feet[:, 2] > z - stepping.SEARCH_M, -FALL_M_S, 0.0)
        motion.feet = Feet(pose=feet, velocity=velocity, air=-1, landed=-1)
        memory.air &= ~planted(m, stepping.ankles(self._true)[:, 2] - z)
        if not memory.air.any() or elapsed >= CATCH_S:
            memory.goal = self._carried_here(memory)
            self.enter(memory, m, "settle")

    def _settle(self, memory: PickupMemory, m: Measurement, motion: Motion, elapsed: float) -> None:
        """Comes into the carry state over the feet, wherever they are."""
        memory.reference = self.along([memory.came_from, memory.goal], elapsed / self.config.settle_s)
        if elapsed >= self.config.settle_s:
            self._step_to_the_support(memory, m)

    def _carried_here(self, memory: PickupMemory) -> Array:
        """The carry state (27,), turned as the body is, its centre of mass in the middle of the soles."""
        yaw = float(yaw_from_quat(np.roll(memory.reference[g1.ROOT_QUAT], 1)))
        feet = stepping.ankles(self._true)
        ahead = np.array([np.cos(feet[:, 3]), np.sin(feet[:, 3])]).T
        middle = (feet[:, :2] + SOLE_AHEAD_M * ahead).mean(axis=0)
        return stepping.moved(self._carry[0], self._com, middle - self._com, yaw)

    def _step_to_the_support(self, memory: PickupMemory, m: Measurement) -> None:
        """Steps to where the plan has the feet, unless they are there."""
        want = self._feet - [self.plan.back_m, 0.0, 0.0, 0.0]
        off = stepping.ankles(self._true) - want
        off[:, 3] = np.arctan2(np.sin(off[:, 3]), np.cos(off[:, 3]))
        c = self.config
        if np.linalg.norm(off[:, :2], axis=1).max() <= c.foot_m and np.abs(off[:, 3]).max() <= c.foot_rad:
            self.enter(memory, m, "raise")
            return
        turn = -float(yaw_from_quat(np.roll(memory.reference[g1.ROOT_QUAT], 1)))
        self._step(memory, m, "approach", Goal(feet=want, com=self._com, turn_rad=turn))

    def _step(self, memory: PickupMemory, m: Measurement, phase: str, end: Goal) -> None:
        self.enter(memory, m, phase)
        stepping.begin_approach(memory, self._true, self._ref, self._mass_kg, end)

    def _approach(self, memory: PickupMemory, m: Measurement, motion: Motion, elapsed: float) -> None:
        if stepping.go_on(memory, m, motion, elapsed):
            self.enter(memory, m, "raise")

    def _raise(self, memory: PickupMemory, m: Measurement, motion: Motion, elapsed: float) -> None:
        memory.reference = self.along([memory.came_from, *self._carry], elapsed / self.config.raise_s)
        if elapsed < self.config.raise_s:
            return
        if self.plan.back_m > 0.0:
            com = stepping.com_with(self._ref, self._mass_kg) + [self.plan.back_m, 0.0]
            self._step(memory, m, "ahead", Goal(feet=self._feet, com=com, turn_rad=0.0))
        else:
            self._begin_to_adjust(memory, m)

    def _ahead(self, memory: PickupMemory, m: Measurement, motion: Motion, elapsed: float) -> None:
        if stepping.go_on(memory, m, motion, elapsed):
            self._begin_to_adjust(memory, m)

    def _begin_to_adjust(self, memory: PickupMemory, m: Measurement) -> None:
        """Finds how far the object is from where the plan has it over its place."""
        memory.shift = np.zeros(3)
        if m.p_WO is not None:
            lifted = self.plan.p_GO + [0.0, 0.0, self._rise_m()]
            off, most = lifted - m.p_WO, self.config.shift_m
            memory.shift = off * min(1.0, most / max(float(np.linalg.norm(off)), 1e-9))
        self.enter(memory, m, "adjust")

    def _rise_m(self) -> float:
        """Height over its place from which the plan lowers the object [m]."""
        z = []
        for q in (self.plan.grasp, self.plan.retreat[self.plan.lift_knots]):
            self._ref.q[:] = q
            self._ref.refresh()
            z.append(self._ref.p_WF[HANDS, 2].mean())
        return float(z[1] - z[0])

    def _adjust(self, memory: PickupMemory, m: Measurement, motion: Motion, elapsed: float) -> None:
        share = ease(elapsed / self.config.adjust_s)
        above = self.plan.retreat[self.plan.lift_knots]
        reference = self.along([memory.came_from, above], elapsed / self.config.adjust_s)
        memory.reference = _shifted(reference, share * memory.shift)
        if elapsed >= self.config.adjust_s:
            self.enter(memory, m, "lower")

    def _lower(self, memory: PickupMemory, m: Measurement, motion: Motion, elapsed: float) -> None:
        c, plan = self.config, self.plan
        sunk = min(max(elapsed - c.lower_s, 0.0) * c.sink_m_s, c.sink_m)
        way = plan.retreat[: plan.lift_knots + 1][::-1]
        memory.reference = _shifted(self.along(way, elapsed / c.lower_s), memory.shift - [0.0, 0.0, sunk])
        if self._stands(m) or (m.p_WO is None and elapsed >= c.lower_s) or sunk >= c.sink_m:
            self.enter(memory, m, "unload")

    def _stands(self, m: Measurement) -> bool:
        """Whether the object is so low that it stands on its support."""
        return m.p_WO is not None and bool(m.p_WO[2] <= self.plan.p_GO[2] + self.config.landed_m)

    def _unload(self, memory: PickupMemory, m: Measurement, motion: Motion, elapsed: float) -> None:
        memory.load_share = 1.0 - ease(elapsed / self.config.unload_s)
        if elapsed >= self.config.unload_s:
            self.enter(memory, m, "let_go")

    def _let_go(self, memory: PickupMemory, m: Measurement, motion: Motion, elapsed: float) -> None:
        memory.squeeze_n = self._squeeze_n * (1.0 - ease(elapsed / self.config.let_go_s))
        if elapsed >= self.config.let_go_s:
            self.enter(memory, m, "open")

    def _open(self, memory: PickupMemory, m: Measurement, motion: Motion, elapsed: float) -> None:
        memory.squeeze_n = memory.load_share = 0.0
        way = [memory.came_from, *self.plan.to_grasp[::-1][1:]]
        memory.reference = self.along(way, elapsed / self.config.open_s)
        if elapsed >= self.config.open_s:
            self.enter(memory, m, "withdraw")

    def _withdraw(self, memory: PickupMemory, m: Measurement, motion: Motion, elapsed: float) -> None:
        memory.reference = self.along(self.plan.to_pregrasp[::-1], elapsed / self.config.withdraw_s)
        if elapsed >= self.config.withdraw_s:
            self.enter(memory, m, "rise")

    def _rise(self, memory: PickupMemory, m: Measurement, motion: Motion, elapsed: float) -> None:
        memory.reference = self.along(self.plan.to_crouch[::-1], elapsed / self.config.rise_s)
        if elapsed >= self.config.rise_s:
            self.enter(memory, m, "abort" if memory.failure else "done", memory.failure)


def planted(m: Measurement, above_m: Array) -> NDArray[np.bool_]:
    """Which feet stand (2,); above_m (2,): of the ankles over where they are on the floor."""
    if m.foot_force_W is None:
        return above_m < PLANTED_M
    return np.linalg.norm(m.foot_force_W, axis=1) >= PLANTED_N


def _shifted(q: Array, shift: Any) -> Array:
    """The configuration (27,) with its root moved by (3,)."""
    out = q.copy()
    out[g1.ROOT_POS] += shift
    return out


Phases.STEPS = {
    "catch": Phases._catch,
    "settle": Phases._settle,
    "approach": Phases._approach,
    "raise": Phases._raise,
    "ahead": Phases._ahead,
    "adjust": Phases._adjust,
    "lower": Phases._lower,
    "unload": Phases._unload,
    "let_go": Phases._let_go,
    "open": Phases._open,
    "withdraw": Phases._withdraw,
    "rise": Phases._rise,
    "done": Phases.rest,
    "abort": Phases.rest,
}
PUT_DOWN_PHASES = tuple(Phases.STEPS)
