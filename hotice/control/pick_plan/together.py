"""First guess of the grasp and of the carry state together: a grasp is worth what the carry state is that its hold leads to.

Hands that hold an object keep their poses relative to each other, and with locked wrists that leaves two arms of four joints
next to no choice: where the object comes to be, level, before an upright pelvis, follows from the grasp alone. One
least-squares problem over both configurations therefore chooses the hold.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hotice.control.pick_plan.guess import ARM_WEIGHT, Guess, posture_weights
from hotice.control.pick_plan.rows import Pose, Rows
from hotice.control.pick_plan.task import ObjectPose
from hotice.control.terms import HANDS, LEFT_HAND, NV, PELVIS
from hotice.model import g1
from hotice.model.frames import quat_from_yaw
from hotice.model.least_squares import minimize

Array = NDArray[np.float64]
N = 2 * NV + 4
GRASP, CARRY, PLACE, YAW = slice(0, NV), slice(NV, 2 * NV), slice(2 * NV, 2 * NV + 3), 2 * NV + 3
HOLD = (200.0, 40.0)
PLACE_WEIGHT = np.array([10.0, 20.0, 10.0])
YAW_WEIGHT = 4.0
HEIGHT_WEIGHT, TURN_WEIGHT = 100.0, 20.0
TRAVEL_WEIGHT = 0.3
STARTS = ((0.0, 0.0, 0.0), (0.2, -0.1, 0.25), (0.5, -0.05, 0.0), (0.0, -0.25, 0.7), (0.3, -0.3, 0.8))
"""Lean [rad], drop of the pelvis [m] and half the bend of the knees [rad] to start the grasp from."""


@dataclass(frozen=True, kw_only=True)
class Together:
    """Grasp and carry (27,), and where the object is in the latter."""

    grasp: Array
    carry: Array
    at: ObjectPose
    cost: float


def grasp_and_carry(guess: Guess) -> Together:
    """The best over `STARTS`."""
    return min((_from(guess, *start) for start in STARTS), key=lambda found: found.cost)


def _from(guess: Guess, lean: float, drop: float, bend: float) -> Together:
    t, task, pin = guess.terms, guess.task, guess.terms._pin
    carry = task.grip.carry
    nominal = np.concatenate([task.q_start[:7], carry.joint_pos])
    end = np.concatenate([carry.root_pos_W, np.roll(carry.quat_WP, -1), carry.joint_pos])
    margin = guess.joint_bounds()
    low = np.concatenate([np.full(6, -1.5), margin[0] - nominal[7:], np.full(6, -1.5), margin[0] - end[7:], [-0.5] * 4])
    high = np.concatenate([np.full(6, 1.5), margin[1] - nominal[7:], np.full(6, 1.5), margin[1] - end[7:], [0.5] * 4])
    pose, eye = Pose(t), np.eye(NV)[6:]
    light, end_weight = posture_weights(ARM_WEIGHT), posture_weights(0.3)
    arms = g1.UPPER
    t.v[:] = 0.0

    def at(x: Array, configuration: slice, base: Array) -> Array:
        t.q[:] = pin.integrate(t.model, base, x[configuration])
        t.refresh()
        return pin.dIntegrate(t.model, base, x[configuration], pin.ARG1)

    def residual(x: Array, stiff: float, turn: float) -> Rows:
        r: list[Array] = []
        J: list[Array] = []

        def add(rows: list[Rows], columns: slice, by_x: Array) -> None:
            for value, by_v in rows:
                wide = np.zeros((len(value), N))
                wide[:, columns] = by_v @ by_x
                r.append(value)
                J.append(wide)

        by_x = at(x, GRASP, nominal)
        joints = np.zeros((20, NV))
        joints[:, 6:] = np.diag(light)
        add([*guess.grasp_rows(pose, stiff, turn), (light * (t.q[7:] - carry.joint_pos), joints)], GRASP, by_x)
        p, R, J_hand = t.p_WF[HANDS].copy(), t.R_WF[HANDS].copy(), t.J_WF[HANDS] @ by_x
        q_arms = t.q[7:][arms].copy()
        by_x = at(x, CARRY, end)
        place, yaw = task.final.p_WO + x[PLACE], float(x[YAW])
        object_ = ObjectPose.of(place, quat_from_yaw(yaw))
        joints = np.zeros((20, NV))
        joints[:, 6:] = np.diag(end_weight)
        height = (HEIGHT_WEIGHT * (t.p_WF[PELVIS, 2:3] - carry.root_pos_W[2]), HEIGHT_WEIGHT * t.J_WF[PELVIS, 2:3])
        add([
            *guess.stand_rows(pose, task.grip.carried.mass_kg, place), height,
            pose.pelvis_turn(np.zeros(3), np.full(3, TURN_WEIGHT)), (end_weight * (t.q[7:] - carry.joint_pos), joints),
        ], CARRY, by_x)  # fmt: skip
        Q, up = object_.R_WO @ task.pose.R_WO.T, np.array([0.0, 0.0, 1.0])
        for i in range(2):
            off = Q @ (p[i] - task.pose.p_WO)
            value, by_v = pose.frame(LEFT_HAND + i, place + off, Q @ R[i], HOLD)
            wide = np.zeros((6, N))
            wide[:, CARRY] = by_v @ by_x
            wide[:3, GRASP], wide[3:, GRASP] = -HOLD[0] * Q @ J_hand[i, :3], -HOLD[1] * Q @ J_hand[i, 3:]
            wide[:3, PLACE], wide[:3, YAW], wide[3:, YAW] = -HOLD[0] * np.eye(3), -HOLD[0] * np.cross(up, off), -HOLD[1] * up
            r.append(value)
            J.append(wide)
        wide = np.zeros((8, N))
        wide[:, CARRY] = TRAVEL_WEIGHT * np.eye(NV)[6:][arms] @ by_x
        wide[:, GRASP] = -TRAVEL_WEIGHT * np.eye(NV)[6:][arms]
        r.append(TRAVEL_WEIGHT * (t.q[7:][arms] - q_arms))
        J.append(wide)
        wide = np.zeros((4, N))
        wide[:3, PLACE], wide[3, YAW] = np.diag(PLACE_WEIGHT), YAW_WEIGHT
        r.append(np.append(PLACE_WEIGHT * x[PLACE], YAW_WEIGHT * yaw))
        J.append(wide)
        return np.concatenate(r), np.concatenate(J)

    x = np.zeros(N)
    x[2], x[4] = drop, lean
    for first in (6, 12):
        x[first], x[first + 3], x[first + 4] = -bend - lean, 2.0 * bend, -bend
    for stiff, turn in ((12.0, 2.0), (300.0, 0.3)):
        x = minimize(lambda v, s=stiff, w=turn: residual(v, s, w), x, low, high, max_steps=120, step_tolerance=1e-5)
    r, _ = residual(x, 300.0, 0.3)
    return Together(
        grasp=pin.integrate(t.model, nominal, x[GRASP]), carry=pin.integrate(t.model, end, x[CARRY]),
        at=ObjectPose.of(task.final.p_WO + x[PLACE], quat_from_yaw(float(x[YAW]))), cost=float(r @ r),
    )  # fmt: skip
