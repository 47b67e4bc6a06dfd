"""Picking an object up from a support, as a phase machine over the whole-body QP.

settle -> crouch -> reach -> close -> squeeze -> lift (-> back, where the support is in the way) -> retreat -> hold.
A missed grasp opens the hands, plans anew and tries again. What cannot be mended ends in `abort`: hands off, back to standing.
Positions are measured in G: origin on the floor between the feet at the start, x ahead.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from hotice.control.contacts import GRAVITY, Contacts
from hotice.control.controller import Command, Measurement
from hotice.control.path import along
from hotice.control.pick_plan import PickPlan, Planner, Support
from hotice.control.step_back import StepBack, plan_step_back
from hotice.control.tasks import Targets
from hotice.control.terms import LEFT_FOOT, LEFT_HAND, PELVIS, RIGHT_FOOT, RIGHT_HAND, Terms
from hotice.control.whole_body_qp import QpConfig, QpMemory, WholeBodyQp
from hotice.errors import InvalidConfig, PickInfeasible
from hotice.model import g1
from hotice.model.objects import CarriedObject

Array = NDArray[np.float64]
HANDS = slice(LEFT_HAND, RIGHT_HAND + 1)
FEET = slice(LEFT_FOOT, RIGHT_FOOT + 1)
STANDING_N = 400.0
TURN_N_M, TURN_NS_M = 1500.0, 60.0
LANDED_N, SEARCH_M = 10.0, 0.01  # a foot that should stand but feels less goes on downwards
PHASES = ("settle", "crouch", "reach", "close", "squeeze", "lift", "back", "retreat", "hold", "open", "stand", "abort")


@dataclass(frozen=True, kw_only=True)
class PickupConfig:
    """Durations, forces and guards of a pick-up, all ours."""

    rate_hz: float = 200.0
    """Control rate."""
    settle_s: float = 0.5
    crouch_s: float = 2.0
    reach_s: float = 1.5
    close_s: float = 1.0
    touch_s: float = 1.5
    """Longest wait for both hands to feel the object."""
    squeeze_s: float = 1.0
    lift_s: float = 1.8
    retreat_s: float = 3.0
    open_s: float = 1.0
    stand_s: float = 2.5
    squeeze_n: tuple[float, float] = (45.0, 60.0)
    """Normal force of each hand for an object without mass and for one of 3.5 kg."""
    touch_n: float = 4.0
    """A hand touches from this force on."""
    hold_n: float = 8.0
    """A hand that holds less for `lost_s` has lost the object."""
    lost_s: float = 0.2
    risen_share: float = 0.5
    """Of the planned rise: less at the end of the lift is a missed grasp."""
    attempts: int = 3
    """Grasps before giving up."""

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            numbers = np.atleast_1d(np.asarray(value, dtype=float))
            if not (np.isfinite(numbers).all() and (numbers > 0).all()):
                raise InvalidConfig(f"{name} is {value!r}: finite numbers above 0 are needed")


@dataclass(kw_only=True)
class PickupMemory:
    """What lasts from step to step.

    Attributes:
        phase, since_s: what is done and since when. plan: of the present attempt, None before the first.
        came_from: (27,) reference when the phase began. reference: (27,) of the last step.
        squeeze_n: present wished force of each hand. lost_since_s: since when a hand feels too little.
        failure: why the pick-up was aborted, empty where it was not. attempt: grasps begun.
    """

    qp: QpMemory
    phase: str
    since_s: float
    came_from: Array
    reference: Array
    start: Array
    plan: PickPlan | None = None
    squeeze_n: float = 0.0
    load_share: float = 0.0
    stepping: StepBack | None = None
    air: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(2, dtype=bool))
    shift_m: float = 0.0
    lost_since_s: float | None = None
    object_z_m: float = 0.0
    attempt: int = 0
    failure: str = ""
    log: list[tuple[float, str, str]] = field(default_factory=list)

    def copy(self) -> PickupMemory:
        """An independent copy; plans are never changed and are shared."""
        return replace(self, qp=copy.deepcopy(self.qp), air=self.air.copy(), log=list(self.log))


class Pickup:
    """The controller; see `hotice.control.controller.Controller`.

    Args:
        carried: the object. support: what it stands on, in G.
        p_GO, quat_GO: where it is expected, (3,) [m] and (4,) wxyz.
        config, qp: parameters.

    Raises:
        CarryInfeasible: the object is too heavy, wide or deep to be held. PickInfeasible: it cannot be reached there.
    """

    def __init__(
        self, carried: CarriedObject, support: Support, p_GO: Array, quat_GO: Array, *, config: PickupConfig | None = None,
        qp: QpConfig | None = None,
    ) -> None:  # fmt: skip
        from hotice.control.pick_plan import ready_joints

        self.config = config or PickupConfig()
        self.carried, self.support = carried, support
        self.planner = Planner(carried, support)
        self.carry = self.planner.carry
        q = np.concatenate([self.carry.root_pos_W, np.roll(self.carry.quat_WP, -1), ready_joints(self.carry)])
        self.start_q = q
        self._check(p_GO, quat_GO)
        self.expected = self.planner.plan(q, np.asarray(p_GO, float), np.asarray(quat_GO, float))
        self._qp = WholeBodyQp(self.planner.wrist_pos, qp)
        self._ref = Terms(self.planner.wrist_pos)
        self._targets, self._contacts = Targets(), Contacts()
        low, high = self.config.squeeze_n
        self.squeeze_n = low + (high - low) * min(carried.mass_kg / 3.5, 1.0)
        self._gains()

    @property
    def rate_hz(self) -> float:
        """Control rate."""
        return self.config.rate_hz

    def start(self, measurement: Measurement) -> PickupMemory:
        """Memory before the first step, of a robot that stands in front of the object."""
        q = _configuration(measurement, self.start_q)
        return PickupMemory(
            qp=self._qp.start(measurement),
            phase="settle",
            since_s=measurement.time_s,
            came_from=q,
            reference=q,
            start=q,
        )

    def step(self, memory: PickupMemory, measurement: Measurement) -> tuple[Command, PickupMemory]:
        """One control step."""
        memory = memory.copy()
        finite = measurement.finite()
        if finite:
            self._qp.terms.update(measurement)
            self._advance(memory, measurement)
            self._follow(memory)
        torque = self._qp.solve(measurement, self._targets, self._contacts, memory.qp, updated=finite).copy()
        return Command(torque=torque, phase=memory.phase, faults=memory.qp.faults), memory

    # what comes next

    def _advance(self, memory: PickupMemory, m: Measurement) -> None:
        c, elapsed, plan = self.config, m.time_s - memory.since_s, memory.plan
        before = memory.reference
        self._com_acc = np.zeros(3)
        if memory.phase == "settle":
            if elapsed >= c.settle_s:
                self._plan(memory, m)
        elif memory.phase == "crouch":
            memory.reference = self._along([memory.came_from, plan.crouch], elapsed / c.crouch_s)
            if elapsed >= c.crouch_s:
                self._enter(memory, m, "reach")
        elif memory.phase == "reach":
            memory.reference = self._along([memory.came_from, plan.pregrasp], elapsed / c.reach_s)
            if elapsed >= c.reach_s:
                memory.attempt += 1
                self._enter(memory, m, "close")
        elif memory.phase == "close":
            memory.reference = self._along([plan.pregrasp, plan.grasp], elapsed / c.close_s)
            pressed = elapsed - 0.7 * c.close_s
            memory.squeeze_n = float(np.clip(20.0 * pressed, 0.0, 25.0))
            if elapsed >= 0.7 * c.close_s and self._feels(m, c.touch_n):
                memory.came_from = memory.reference
                self._enter(memory, m, "squeeze")
            elif elapsed >= c.close_s + c.touch_s:
                self._missed(memory, m, "hands felt nothing")
        elif memory.phase == "squeeze":
            share = min(elapsed / c.squeeze_s, 1.0)
            memory.reference = self._along([memory.came_from, plan.grasp], 2.0 * share)
            memory.squeeze_n = (
                max(memory.squeeze_n, 25.0) if share == 0 else 25.0 + (self.squeeze_n - 25.0) * min(2 * share, 1)
            )
            memory.load_share = max(2.0 * share - 1.0, 0.0)
            if elapsed >= c.squeeze_s:
                if self._feels(m, 0.4 * self.squeeze_n):
                    memory.object_z_m = float(m.p_WO[2])
                    self._enter(memory, m, "lift")
                else:
                    self._missed(memory, m, "hands could not squeeze")
        elif memory.phase == "lift":
            memory.load_share = 1.0
            memory.reference = self._along(plan.retreat[: plan.lift_knots + 1], elapsed / c.lift_s)
            risen, planned = float(m.p_WO[2]) - memory.object_z_m, self.planner.rise_m
            if elapsed >= c.lift_s:
                if risen < c.risen_share * planned:
                    self._missed(memory, m, f"object rose {100 * risen:.0f} of {100 * planned:.0f} cm")
                elif plan.back_m > 0.0:
                    memory.stepping = self._stepping(memory, plan.back_m)
                    self._enter(memory, m, "back")
                else:
                    self._enter(memory, m, "retreat")
        elif memory.phase == "back":
            shift, self._com_acc[:2] = memory.stepping.shift(elapsed)
            swing, landing, self._feet, self._feet_rate = memory.stepping.feet_at(elapsed)
            memory.air[:] = np.arange(2) == swing
            if landing >= 0 and m.foot_force_W is not None and np.linalg.norm(m.foot_force_W[landing]) < LANDED_N:
                self._feet[landing, 2] -= SEARCH_M
                memory.air[landing] = True
            memory.reference = memory.came_from.copy()
            memory.reference[:2] += shift
            if elapsed >= memory.stepping.seconds:
                memory.shift_m, memory.air[:] = -plan.back_m, False
                self._enter(memory, m, "retreat")
        elif memory.phase == "retreat":
            memory.reference = self._along(plan.retreat[plan.lift_knots :], elapsed / c.retreat_s)
            memory.reference[0] += memory.shift_m
            if elapsed >= c.retreat_s:
                self._enter(memory, m, "hold")
        elif memory.phase == "open":
            memory.squeeze_n = memory.load_share = 0.0
            memory.reference = self._along([memory.came_from, plan.pregrasp, plan.crouch], elapsed / c.open_s)
            if elapsed >= c.open_s:
                if memory.failure:
                    self._enter(memory, m, "stand")
                else:
                    self._plan(memory, m)
        elif memory.phase == "stand":
            memory.reference = self._along([memory.came_from, memory.start], elapsed / c.stand_s)
            if elapsed >= c.stand_s:
                self._enter(memory, m, "abort")
        if memory.phase in ("lift", "back", "retreat", "hold"):
            self._watch(memory, m)
        self._rate = self._qp.terms._pin.difference(self._ref.model, before, memory.reference) * c.rate_hz

    def _enter(self, memory: PickupMemory, m: Measurement, phase: str, note: str = "") -> None:
        memory.phase, memory.since_s, memory.came_from, memory.lost_since_s = phase, m.time_s, memory.reference, None
        memory.log.append((m.time_s, phase, note))

    def _plan(self, memory: PickupMemory, m: Measurement) -> None:
        try:
            if m.p_WO is None:
                raise PickInfeasible("the object is not seen")
            self._check(m.p_WO, m.quat_WO)
            memory.plan = self.planner.plan(memory.start, m.p_WO, m.quat_WO)
            self._enter(memory, m, "crouch")
        except PickInfeasible as error:
            memory.failure = str(error)
            self._enter(memory, m, "stand", memory.failure)

    def _missed(self, memory: PickupMemory, m: Measurement, why: str) -> None:
        if memory.attempt >= self.config.attempts:
            memory.failure = why
        self._enter(memory, m, "open", why)

    def _watch(self, memory: PickupMemory, m: Measurement) -> None:
        if self._feels(m, self.config.hold_n):
            memory.lost_since_s = None
        elif memory.lost_since_s is None:
            memory.lost_since_s = m.time_s
        elif m.time_s - memory.lost_since_s > self.config.lost_s:
            memory.failure = f"lost the object in {memory.phase}"
            memory.plan = replace(memory.plan, pregrasp=memory.reference, crouch=memory.reference)
            self._enter(memory, m, "open", memory.failure)

    def _feels(self, m: Measurement, least_n: float) -> bool:
        if m.hand_force_W is None:
            return True
        return bool((np.linalg.norm(m.hand_force_W, axis=1) >= least_n).all())

    def _check(self, p_GO: Array, quat_GO: Array) -> None:
        for name, value, size in (("p_GO", p_GO, 3), ("quat_GO", quat_GO, 4)):
            array = np.asarray(value, dtype=float)
            if array.shape != (size,) or not np.isfinite(array).all():
                raise PickInfeasible(f"{name} of the object has shape {array.shape}: {size} finite numbers are needed")

    # how it is done

    def _along(self, knots, share: float) -> Array:
        return along(self._ref._pin, self._ref.model, np.asarray(knots), share)

    def _gains(self) -> None:
        t = self._targets
        t.gain_com([20.0, 20.0, 0.0], 5.0)
        t.gain_frame("pelvis", [0.0, 0.0, 20.0, 10.0, 10.0, 10.0], 7.0)
        t.gain_joints(np.where(np.arange(20) < g1.LOWER.stop, 0.02, 1.0), 12.0)
        for hand in ("left_hand", "right_hand"):
            t.gain_frame(hand, [4.0, 4.0, 4.0, 2.0, 2.0, 0.0], 12.0)
        for foot in ("left_foot", "right_foot"):  # of a foot in the air
            t.gain_frame(foot, 30.0, 16.0)

    def _stepping(self, memory: PickupMemory, distance_m: float) -> StepBack:
        """Course of stepping back from where the feet of the reference are."""
        ref, load = self._ref, self.carried.mass_kg
        held = ref.p_WF[HANDS].mean(axis=0)
        com = (ref.mass_kg * ref.com[:2] + load * held[:2]) / (ref.mass_kg + load)
        return plan_step_back(self._qp.terms.p_WF[FEET].copy(), com, float(ref.com[2]), distance_m)

    def _press(self, memory: PickupMemory) -> Array:
        """Where the hands press, (2, 3) in W."""
        t = self._qp.terms
        point = self._contacts.hand_point if memory.plan is None else memory.plan.hand_point
        return t.p_WF[HANDS] + np.einsum("hij,hj->hi", t.R_WF[HANDS], point)

    def _follow(self, memory: PickupMemory) -> None:
        ref, t, k = self._ref, self._targets, self._contacts
        ref.q[:], ref.v[:] = memory.reference, self._rate
        ref.refresh()
        t.com_pos[:], t.com_vel[:], t.com_acc[:] = ref.com, ref.v_com, self._com_acc
        t.frame_pos[PELVIS], t.frame_rot[PELVIS], t.frame_vel[PELVIS] = (
            ref.p_WF[PELVIS],
            ref.R_WF[PELVIS],
            ref.v_WF[PELVIS],
        )
        t.frame_pos[HANDS], t.frame_vel[HANDS], t.frame_rot[HANDS] = ref.p_WF[HANDS], ref.v_WF[HANDS], ref.R_WF[HANDS]
        t.joint_pos[:], t.joint_vel[:] = ref.q[7:], ref.v[6:]
        k.foot_force_max_n[:] = STANDING_N
        if memory.air.any():
            k.foot_force_max_n[memory.air] = 0.0
            t.frame_pos[FEET], t.frame_vel[FEET, :3] = self._feet, self._feet_rate
        true, press = self._qp.terms, self._press(memory)
        line = press[0] - press[1]  # between the palms as they are: no moment on the object
        line /= np.linalg.norm(line)
        k.hand_normal_W[0], k.hand_normal_W[1] = line, -line
        k.hand_force_ref_W[:] = memory.squeeze_n * k.hand_normal_W
        if memory.load_share > 0.0:  # stiffer against turning the object than the light arms are by their tasks
            off, rate = true.p_WF[HANDS] - ref.p_WF[HANDS], true.v_WF[HANDS, :3] - ref.v_WF[HANDS, :3]
            turn = 0.5 * memory.load_share * (TURN_N_M * (off[0] - off[1]) + TURN_NS_M * (rate[0] - rate[1]))
            turn -= (turn @ line) * line
            k.hand_force_ref_W[0] += turn
            k.hand_force_ref_W[1] -= turn
        k.hand_force_max_n[:] = 2.0 * self.squeeze_n if memory.squeeze_n > 0 else 0.0
        k.load_kg = memory.load_share * self.carried.mass_kg
        k.hand_moment_W[:] = 0.0
        if memory.plan is not None:
            k.hand_point[:] = memory.plan.hand_point
        if memory.plan is not None and k.load_kg > 0.0:
            weight = 0.5 * k.load_kg * GRAVITY
            for hand, R in enumerate(self._qp.terms.R_WF[HANDS]):
                ahead = R @ (memory.plan.p_HO[hand] - memory.plan.hand_point[hand])
                k.hand_moment_W[hand, 1] = ahead[0] * weight


def _configuration(m: Measurement, fallback: Array) -> Array:
    q = np.concatenate([m.p_WP, np.roll(m.quat_WP, -1), m.joint_pos])
    return q if np.isfinite(q).all() else fallback.copy()
