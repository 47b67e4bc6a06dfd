"""Steps of a pick-up: body, feet and reference along a course of `hotice.control.pickup.footwork`."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from hotice.control.controller import Measurement
from hotice.control.pickup.footwork import Departure, Goal, plan_approach, plan_steps
from hotice.control.pickup.memory import Motion, PickupMemory
from hotice.control.whole_body.terms import FEET, HANDS, Terms
from hotice.model import g1
from hotice.model.frames import quat_from_yaw, quat_mul, quat_rotate

Array = NDArray[np.float64]
LANDED_N, SEARCH_M = 10.0, 0.01  # a foot that should stand but feels less goes on downwards


def begin(memory: PickupMemory, true: Terms, ref: Terms, load_kg: float, departure: Departure) -> None:
    """Plans steps from where the feet are, for the body and the load as the reference has them."""
    memory.com0 = com_with(ref, load_kg)
    memory.course = plan_steps(ankles(true), memory.com0, float(ref.com[2]), departure)


def begin_approach(memory: PickupMemory, true: Terms, ref: Terms, load_kg: float, end: Goal) -> None:
    """Plans steps to a stance nearby, as `begin`."""
    memory.com0 = com_with(ref, load_kg)
    memory.course = plan_approach(ankles(true), memory.com0, float(ref.com[2]), end)


def com_with(terms: Terms, load_kg: float) -> Array:
    """Centre of mass (2,) of robot and load, which is between the hands."""
    held = terms.p_WF[HANDS].mean(axis=0)
    return (terms.mass_kg * terms.com[:2] + load_kg * held[:2]) / (terms.mass_kg + load_kg)


def ankles(terms: Terms) -> Array:
    """Both ankles, left and right: x, y, z [m], yaw [rad], (2, 4)."""
    R = terms.R_WF[FEET]
    return np.column_stack([terms.p_WF[FEET], np.arctan2(R[:, 1, 0], R[:, 0, 0])])


def go_on(memory: PickupMemory, m: Measurement, motion: Motion, elapsed: float) -> bool:
    """Moves reference and feet along the course; whether it is over."""
    course: Any = memory.course  # there since `begin`
    body, feet = course.body_at(elapsed), course.feet_at(elapsed)
    motion.feet, motion.com_acc[:2] = feet, body.acceleration
    memory.air[:] = np.arange(2) == feet.air
    landed = feet.landed
    if landed >= 0 and m.foot_force_W is not None and np.linalg.norm(m.foot_force_W[landed]) < LANDED_N:
        feet.pose[landed, 2] -= SEARCH_M
        memory.air[landed] = True
    memory.reference = moved(memory.came_from, memory.com0, body.shift, body.turn_rad)
    return elapsed >= course.seconds


def moved(q: Array, com: Array, shift: Array, turn_rad: float) -> Array:
    """The configuration (27,) turned about the vertical through `com` (2,) and shifted by (2,)."""
    turn, pivot = quat_from_yaw(turn_rad), np.array([*com, 0.0])
    root = quat_rotate(turn, q[g1.ROOT_POS] - pivot) + pivot
    root[:2] += shift
    quat = np.roll(quat_mul(turn, np.roll(q[g1.ROOT_QUAT], 1)), -1)
    return np.concatenate([root, quat, q[g1.JOINT_POS]], dtype=np.float64)
