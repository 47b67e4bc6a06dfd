"""Books of picks from plans: joint path, grip and load over time, and the targets that hold them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hotice.control.pick_plan import PickPlan, Planner, Support, frames_at
from hotice.control.pickup.config import PickupConfig
from hotice.control.pickup.machine import along
from hotice.control.pickup.phases import FIRST_SQUEEZE_N
from hotice.control.playback.statics import static_torque
from hotice.errors import PickInfeasible
from hotice.model import g1
from hotice.model.frames import quat_from_yaw
from hotice.model.objects import CarriedObject
from hotice.model.picks.book import BOOK_PHASES, DT_S, SHAPES, PickBook

Array = NDArray[np.float64]
Share = Callable[[float], float]
PLAYED = PickupConfig(settle_s=0.4, crouch_s=1.4, reach_s=1.0, close_s=0.7, squeeze_s=0.8, lift_s=1.2, retreat_s=4.4)
"""Durations of what is played back: nobody waits for hands that feel."""
HEAVIEST_KG = 3.5
LEAST_GAP_M = 0.03
"""Between the support and an object over it, in the carry state."""


@dataclass(frozen=True, kw_only=True)
class Pick:
    """One object on its support, seen from G: x, y of its centre [m], its turn [rad]."""

    carried: CarriedObject
    support: Support
    x_m: float
    y_m: float
    yaw_rad: float

    @property
    def p_GO(self) -> Array:
        """Centre of the object, (3,) [m]."""
        return np.array([self.x_m, self.y_m, self.support.top_m + self.carried.half_extents_m[2]])


def plan_book(pick: Pick, config: PickupConfig = PLAYED) -> PickBook:
    """The book of one pick.

    Raises:
        CarryInfeasible: the object cannot be held.
        PickInfeasible: it cannot be reached there, or the robot would have to step back with it.
    """
    planner = Planner(pick.carried, pick.support, config.durations, calm=True)
    if planner.grip.steps_back:
        raise PickInfeasible(
            f"support {pick.support.top_m:.2f} m high is in the way of the carry state: a robot that stands cannot "
            "lower the object there, give a lower support"
        )
    plan = planner.plan(planner.start_q, pick.p_GO, quat_from_yaw(pick.yaw_rad))
    book = book_of(planner, plan, pick, config)
    _check_clear(book, pick)
    return book


def _check_clear(book: PickBook, pick: Pick) -> None:
    """Raises `PickInfeasible` where the object would end on its support, or almost."""
    half, (x, _, z) = pick.carried.half_extents_m, book.pelvis[0, -1] + book.end[0]
    gap = float(z - half[2] - pick.support.top_m)
    if x + half[0] > pick.support.near_m and gap < LEAST_GAP_M:
        raise PickInfeasible(
            f"carry state {1e2 * gap:.1f} cm above the support: at least {1e2 * LEAST_GAP_M:.0f} cm are needed, give a "
            "lower support"
        )


def book_of(planner: Planner, plan: PickPlan, pick: Pick, config: PickupConfig = PLAYED) -> PickBook:
    """The book of a plan: its path in the durations of `config`, with static torques for grip and load."""
    light, heavy = config.squeeze_n
    squeeze = light + (heavy - light) * min(pick.carried.mass_kg / HEAVIEST_KG, 1.0)
    path, phase, press, load = _timed(planner, plan, config, squeeze)
    kp, _ = g1.gains()
    kg = pick.carried.mass_kg
    torque = np.array(
        [
            static_torque(planner.terms, q, n, share * kg, plan.p_HO, plan.hand_point)[0]
            for q, n, share in zip(path, press, load, strict=True)
        ]
    )
    end = path[-1]
    joints = path[:, g1.JOINT_POS]
    hands = frames_at(planner.terms, end)
    start = planner.start_q

    def row(value: object) -> Array:
        return np.asarray(value, dtype=np.float64)[None]

    return PickBook(
        joint_pos=joints[None].astype(np.float32),
        target=(joints + torque / kp)[None].astype(np.float32),
        pelvis=path[None, :, g1.ROOT_POS].astype(np.float32),
        phase=phase,
        shape=np.array([SHAPES.index(pick.carried.shape)]),
        extents=row(2.0 * pick.carried.half_extents_m),
        mass=row(pick.carried.mass_kg),
        object=row([*pick.p_GO, pick.yaw_rad if pick.carried.shape == "box" else 0.0]),
        support=row([pick.support.top_m, pick.support.near_m]),
        start=row([*start[g1.ROOT_POS], *np.roll(start[g1.ROOT_QUAT], 1), *start[g1.JOINT_POS]]),
        end=row(hands.p.mean(axis=0) - plan.p_OH.mean(axis=0) - end[g1.ROOT_POS]),
        lean=row(2.0 * np.arcsin(np.clip(end[4], -1.0, 1.0))),
        wrist=row(planner.wrist_pos),
        squeeze=row(squeeze),
    )


def _timed(
    planner: Planner, plan: PickPlan, config: PickupConfig, squeeze: float
) -> tuple[Array, NDArray[np.int64], Array, Array]:
    """Configurations (K, 27), phases (K,), force of each hand (K,) [N] and share of the load that they carry (K,)."""
    pin, model = planner.terms._pin, planner.terms.model
    first = FIRST_SQUEEZE_N

    def closing(s: float) -> float:
        return first * max(s - 0.7, 0.0) / 0.3

    def squeezing(s: float) -> float:
        return first + (squeeze - first) * min(2.0 * s, 1.0)

    def none(s: float) -> float:
        return 0.0

    def whole(s: float) -> float:
        return 1.0

    knots = plan.lift_knots
    parts: tuple[tuple[Array, float, Share, Share], ...] = (
        (np.stack([planner.start_q] * 2), config.settle_s, none, none),
        (plan.to_crouch, config.crouch_s, none, none),
        (plan.to_pregrasp, config.reach_s, none, none),
        (plan.to_grasp, config.close_s, closing, none),
        (np.stack([plan.grasp] * 2), config.squeeze_s, squeezing, lambda s: max(2.0 * s - 1.0, 0.0)),
        (plan.retreat[: knots + 1], config.lift_s, lambda s: squeeze, whole),
        (plan.retreat[knots:], config.retreat_s, lambda s: squeeze, whole),
    )
    path, phase, press, load = [], [], [], []
    for number, (way, seconds, force, share) in enumerate(parts):
        count = round(seconds / DT_S)
        for k in range(1, count + 1):
            s = k / count
            path.append(along(pin, model, way, s))
            phase.append(number)
            press.append(force(s))
            load.append(share(s))
    assert len(parts) == len(BOOK_PHASES) - 1
    return np.array(path), np.array(phase), np.array(press), np.array(load)
