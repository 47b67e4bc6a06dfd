"""The five keyframes of a pick-up: crouch, pregrasp, grasp, lifted, carry; each a problem of inverse kinematics."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hotice.control.pick_plan.grip import ready_joints
from hotice.control.pick_plan.guess.hold import grasp_and_carry
from hotice.control.pick_plan.guess.postures import ARM_WEIGHT, Guess, posture_weights
from hotice.control.pick_plan.keyframes.demands import HANDS, PALM_GAPS_M, Demands
from hotice.control.pick_plan.keyframes.ik import AHEAD_M
from hotice.control.pick_plan.keyframes.robot import DrakeRobot
from hotice.control.pick_plan.task import (
    PREGRASP_GAP_M,
    TIPS_ABOVE_M,
    TIPS_M,
    Frames,
    ObjectPose,
    PickTask,
    frames_at,
)
from hotice.control.whole_body.terms import PELVIS, Terms
from hotice.errors import PickInfeasible
from hotice.model import g1
from hotice.model.frames import quat_from_axis_angle, quat_from_yaw, quat_mul

Array = NDArray[np.float64]
PALM_PLACE_M = 0.08
HELD_M, HELD_RAD = 0.001, 0.01
"""Largest motion of the hands relative to each other while they hold the object [m]."""
LIFTED_M, LIFTED_RAD = 0.02, 0.05
"""Largest distance of the lifted object from its place [m]."""
CARRY_M, CARRY_RAD = 0.03, 0.1
"""Largest distance of the object at the end from where the first guess has it [m], which is as near to the carry
state as locked wrists allow."""
PELVIS_M = 0.004
LEVEL_SINE = 0.05


@dataclass(frozen=True, kw_only=True)
class Keyframes:
    """Configurations (27,) in G; `hands`: the hands' poses at the grasp."""

    crouch: Array
    pregrasp: Array
    grasp: Array
    lifted: Array
    carry: Array
    hands: Frames


class KeyframeSolver:
    """Solver of one task's keyframes; `terms` serve as scratch. Raises `PickInfeasible`, naming what cannot be kept."""

    def __init__(self, task: PickTask, robot: DrakeRobot, terms: Terms) -> None:
        self.task, self.terms = task, terms
        self._demand = Demands(task, robot)
        self._guess = Guess(terms, task)

    def solve(self) -> Keyframes:
        """All five."""
        task, guess = self.task, self._guess
        both = grasp_and_carry(guess)
        grasp = self._grasp(both.grasp)
        hands = frames_at(self.terms, grasp)
        pelvis = self.terms.p_WF[PELVIS].copy()
        p_OH = (hands.p - task.pose.p_WO) @ task.pose.R_WO
        pregrasp = self._before(guess.pregrasp(grasp, p_OH), grasp, pelvis, p_OH)
        crouch = self._before(guess.crouch(grasp), grasp, pelvis, None)
        rpy = _rpy(self.terms, grasp)
        up = hands.carried_along(task.pose, task.lifted)
        guessed = guess.held(grasp, grasp[g1.JOINT_POS], up, task.lifted, rpy, arms=0.5)
        lifted = self._held(
            guessed,
            grasp[g1.JOINT_POS],
            up,
            task.lifted,
            grasp[g1.ROOT_QUAT],
            0.5,
            (LIFTED_M, LIFTED_RAD),
            "lifting the object",
        )
        low = hands.carried_along(task.pose, both.at)
        carry = task.grip.carry
        end = self._held(
            both.carry,
            carry.joint_pos,
            low,
            both.at,
            np.roll(carry.quat_WP, -1),
            0.3,
            (CARRY_M, CARRY_RAD),
            "the carry state",
            pelvis_m=float(carry.root_pos_W[2]),
        )
        return Keyframes(crouch=crouch, pregrasp=pregrasp, grasp=grasp, lifted=lifted, carry=end, hands=hands)

    def _grasp(self, guess: Array) -> Array:
        """The palms as flush as they can be."""
        *tight, loose = PALM_GAPS_M[self.task.grip.carried.shape]
        for off in tight:
            try:
                return self._grasp_within(off, guess)
            except PickInfeasible:
                continue
        return self._grasp_within(loose, guess)

    def _grasp_within(self, off_m: float, guess: Array) -> Array:
        task, grip = self.task, self.task.grip
        pose, carried = task.pose, grip.carried
        ik = self._demand.standing(0.0, pose.p_WO)
        ik.balance(task.com_box_m, carried.mass_kg, pose.p_WO, "centre of mass with the object over the feet")
        frames = frames_at(self.terms, guess)
        if grip.steps_back:
            self._demand.low(ik)
        elif carried.shape != "box":
            ik.point("pelvis", np.zeros(3), [0.0, 0.0, 0.7], [0.0, 0.0, 3.0], np.eye(3))
        box = carried.shape == "box"
        self._demand.palms(ik, grip.gaps_m(), off_m, 300.0 if box else 0.0)
        seen = [np.zeros(3), [AHEAD_M, 0.0, 0.0], *([] if box else [[0.0, 0.0, AHEAD_M]])]
        for i, link in enumerate(HANDS):
            place = pose.p_WO + pose.R_WO @ grip.place[i]
            reach = np.full(3, PALM_PLACE_M)
            ik.within(
                link, self._demand.hand(i), -reach, reach, "palms at their places on the object", place, pose.R_WO
            )
            for off in seen:
                ik.point(
                    link, self._demand.hand(i) + off, frames.p[i] + frames.R[i] @ off, np.full(3, 100.0), pose.R_WO
                )
            ik.level(link, self._demand.hand(i), max(LEVEL_SINE, abs(float(frames.R[i, 2, 0]))), "level forearms")
        self._demand.chest(ik, self.terms)
        quat = quat_mul(quat_from_yaw(task.yaw), quat_from_axis_angle([0.0, 1.0, 0.0], np.asarray(0.1)))
        ik.pelvis_turn(np.asarray(quat, dtype=np.float64), [6.0, 1.0, 0.3])
        ik.posture(grip.carry.joint_pos, posture_weights(ARM_WEIGHT))
        x, y, z = pose.p_WO
        return ik.solve(
            guess,
            f"{carried.shape} at x {x:.2f}, y {y:.2f}, z {z:.2f} m from the feet, turned "
            f"{np.degrees(task.yaw):.0f} deg, cannot be grasped standing; stand nearer and face it",
        )

    def _before(self, guess: Array, grasp: Array, pelvis: Array, p_OH: Array | None) -> Array:
        """Posture before the grasp: near its body, hands above the support; with `p_OH` (2, 3) beside the object."""
        task, grip = self.task, self.task.grip
        ik = self._demand.standing(0.0, task.pose.p_WO)
        ik.pelvis(pelvis, np.roll(grasp[g1.ROOT_QUAT], 1), (10.0, 10.0))
        top = grip.support.top_m + TIPS_ABOVE_M
        for i, link in enumerate(HANDS):
            for tip in TIPS_M:
                above, inf = [-np.inf, -np.inf, top], np.full(3, np.inf)
                ik.within(link, self._demand.hand(i) + tip, above, inf, "hands above the support")
        if p_OH is None:
            ready = np.concatenate([grasp[g1.JOINT_POS][g1.LOWER], ready_joints(grip.carry)[g1.UPPER]])
            ik.posture(ready, posture_weights(1.0))
            return ik.solve(guess, "no way to crouch before the object")
        self._demand.palms(ik, grip.gaps_m(PREGRASP_GAP_M), PALM_GAPS_M[grip.carried.shape][-1], 50.0)
        for i, link in enumerate(HANDS):
            place = task.pose.p_WO + task.pose.R_WO @ p_OH[i]
            ik.point(link, self._demand.hand(i), place, [15.0, 0.0, 15.0], task.pose.R_WO)
        ik.posture(grasp[g1.JOINT_POS], posture_weights(ARM_WEIGHT))
        return ik.solve(guess, "no room for the hands beside the object")

    def _held(
        self,
        guess: Array,
        posture: Array,
        hands: Frames,
        at: ObjectPose,
        quat: Array,
        arms: float,
        free: tuple[float, float],
        what: str,
        pelvis_m: float | None = None,
    ) -> Array:
        """Hands as they hold the object at `at`, which may be off by `free` [m], [rad].

        quat (4,): target turn of the pelvis, xyzw; `pelvis_m`: its height, where that is demanded.
        """
        mass = self.task.grip.carried.mass_kg
        ik = self._demand.standing(mass, at.p_WO)
        left, right = HANDS
        p_LR, R_LR = hands.R[0].T @ (hands.p[1] - hands.p[0]), hands.R[0].T @ hands.R[1]
        held = "hold of the object"
        ik.place(right, self._demand.hand(1), self._demand.hand(0) + p_LR, R_LR, held, HELD_M, HELD_RAD, seen_from=left)
        ik.place(left, self._demand.hand(0), hands.p[0], hands.R[0], "object on its way", *free)
        for i, link in enumerate(HANDS):
            for off in (np.zeros(3), [AHEAD_M, 0.0, 0.0]):
                ik.point(link, self._demand.hand(i) + off, hands.p[i] + hands.R[i] @ off, np.full(3, 140.0), np.eye(3))
        if self.task.grip.steps_back and at is self.task.lifted:
            self._demand.low(ik)
        if pelvis_m is not None:
            inf = np.inf
            low, high = [-inf, -inf, pelvis_m - PELVIS_M], [inf, inf, pelvis_m + PELVIS_M]
            ik.within("pelvis", np.zeros(3), low, high, "pelvis at the height of the carry state")
        ik.pelvis_turn(np.roll(quat, 1), [2.0, 1.0, 1.0] if pelvis_m is None else np.full(3, 30.0))
        ik.posture(posture, posture_weights(arms))
        return ik.solve(guess, f"no configuration for {what}")


def _rpy(terms: Terms, q: Array) -> Array:
    pin = terms._pin
    return pin.rpy.matrixToRpy(pin.Quaternion(q[g1.ROOT_QUAT]).matrix())
