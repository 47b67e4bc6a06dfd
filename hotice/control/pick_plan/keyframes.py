"""The five configurations that a pick-up passes: crouch, pregrasp, grasp, lifted, carry; each an inverse-kinematics problem."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hotice.control.pick_plan.drake_ik import AHEAD_M, DrakeRobot, KeyframeIk
from hotice.control.pick_plan.grip import PALM_POINTS_M, PALM_RADIUS_M, ready_joints
from hotice.control.pick_plan.guess import ARM_WEIGHT, LEG_WEIGHT, Guess
from hotice.control.pick_plan.task import (
    CHEST_GAP_M,
    CHEST_M,
    COM_BOX_M,
    KNEE_ROOM_M,
    PREGRASP_GAP_M,
    STEPPING_HEIGHT_M,
    TIPS_ABOVE_M,
    TIPS_M,
    Frames,
    ObjectPose,
    PickTask,
    frames_at,
)
from hotice.control.terms import PELVIS, Terms
from hotice.model import g1
from hotice.model.carry import surface_distance
from hotice.model.frames import quat_from_axis_angle, quat_from_yaw, quat_mul

Array = NDArray[np.float64]
FEET = tuple(f"{side}_ankle_roll_link" for side in g1.SIDES)
HANDS = tuple(f"{side}_wrist_yaw_link" for side in g1.SIDES)
KNEES = tuple(f"{side}_knee_link" for side in g1.SIDES)
SIGN = (1.0, -1.0)
PALM_GAP_M = 0.008  # locked wrists cannot make palms perfectly flush
PALM_PLACE_M = 0.08
HELD_M, HELD_RAD = 0.001, 0.01
"""How far the hands may move relative to each other while they hold the object."""
LIFTED_M, LIFTED_RAD = 0.02, 0.05
"""How far the lifted object may be beside its place."""
CARRY_M, CARRY_RAD = 0.03, 0.1
"""How far the object may end from where the first guess has it, which is as near to the carry state as locked wrists allow."""
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
    """Solves the keyframes of one task; `terms` serve as scratch. Raises `PickInfeasible`, naming what cannot be kept."""

    def __init__(self, task: PickTask, robot: DrakeRobot, terms: Terms) -> None:
        self.task, self.robot, self.terms = task, robot, terms
        self._guess = Guess(terms, task)

    def solve(self) -> Keyframes:
        """All five."""
        task, guess = self.task, self._guess
        grasp = self._grasp(guess.grasp())
        hands = frames_at(self.terms, grasp)
        pelvis = self.terms.p_WF[PELVIS].copy()
        p_OH = (hands.p - task.pose.p_WO) @ task.pose.R_WO
        pregrasp = self._before(guess.pregrasp(grasp, p_OH), grasp, pelvis, p_OH)
        crouch = self._before(guess.crouch(grasp), grasp, pelvis, None)
        rpy = _rpy(self.terms, grasp)
        up = hands.carried_along(task.pose, task.lifted)
        guessed = guess.held(grasp, grasp[7:], up, task.lifted, rpy, arms=0.5)
        lifted = self._held(
            guessed, grasp[7:], up, task.lifted, grasp[3:7], 0.5, (LIFTED_M, LIFTED_RAD), "lifting the object"
        )
        guessed = guess.carried(hands)
        found = frames_at(self.terms, guessed)
        at = ObjectPose(p_WO=found.p.mean(axis=0) - task.final.R_WO @ p_OH.mean(axis=0), R_WO=task.final.R_WO)
        low = hands.carried_along(task.pose, at)
        carry = task.grip.carry
        end = self._held(
            guessed, carry.joint_pos, low, at, np.roll(carry.quat_WP, -1), 0.3, (CARRY_M, CARRY_RAD), "the carry state",
            pelvis_m=float(carry.root_pos_W[2]),
        )  # fmt: skip
        return Keyframes(crouch=crouch, pregrasp=pregrasp, grasp=grasp, lifted=lifted, carry=end, hands=hands)

    def _grasp(self, guess: Array) -> Array:
        task, grip = self.task, self.task.grip
        pose, carried = task.pose, grip.carried
        ik = self._standing(0.0, pose.p_WO)
        ik.balance(COM_BOX_M, carried.mass_kg, pose.p_WO, "centre of mass with the object over the feet")
        frames = frames_at(self.terms, guess)
        if grip.steps_back:
            self._low(ik)
        elif carried.shape != "box":
            ik.point("pelvis", np.zeros(3), [0.0, 0.0, 0.7], [0.0, 0.0, 3.0], np.eye(3))
        self._palms(ik, grip.toe_m, 300.0)
        for i, link in enumerate(HANDS):
            place = pose.p_WO + pose.R_WO @ grip.place[i]
            reach = np.full(3, PALM_PLACE_M)
            ik.within(link, self._hand(i), -reach, reach, "palms at their places on the object", place, pose.R_WO)
            ik.point(link, self._hand(i), place, np.full(3, 15.0), pose.R_WO)
            ik.level(link, self._hand(i), max(LEVEL_SINE, abs(float(frames.R[i, 2, 0]))), "level forearms")
        self._chest(ik)
        quat = quat_mul(quat_from_yaw(task.yaw), quat_from_axis_angle([0.0, 1.0, 0.0], np.asarray(0.1)))
        ik.pelvis_turn(np.asarray(quat, dtype=np.float64), [6.0, 1.0, 0.3])
        ik.posture(grip.carry.joint_pos, _weights(ARM_WEIGHT))
        x, y, z = pose.p_WO
        return ik.solve(
            guess,
            f"{carried.shape} at x {x:.2f}, y {y:.2f}, z {z:.2f} m from the feet, turned {np.degrees(task.yaw):.0f} deg, "
            "cannot be grasped standing; stand nearer and face it",
        )

    def _before(self, guess: Array, grasp: Array, pelvis: Array, p_OH: Array | None) -> Array:
        """Before the grasp: near its body, hands above the support; with `p_OH` (2, 3) the palms wait beside the object."""
        task, grip = self.task, self.task.grip
        ik = self._standing(0.0, task.pose.p_WO)
        ik.pelvis(pelvis, np.roll(grasp[3:7], 1), (10.0, 10.0))
        top = grip.support.top_m + TIPS_ABOVE_M
        for i, link in enumerate(HANDS):
            for tip in TIPS_M:
                above, inf = [-np.inf, -np.inf, top], np.full(3, np.inf)
                ik.within(link, self._hand(i) + tip, above, inf, "hands above the support")
        if p_OH is None:
            ready = np.concatenate([grasp[7:19], ready_joints(grip.carry)[g1.UPPER]])
            ik.posture(ready, _weights(1.0))
            return ik.solve(guess, "no way to crouch before the object")
        self._palms(ik, PREGRASP_GAP_M + grip.toe_m, 50.0)
        for i, link in enumerate(HANDS):
            place = task.pose.p_WO + task.pose.R_WO @ p_OH[i]
            ik.point(link, self._hand(i), place, [15.0, 0.0, 15.0], task.pose.R_WO)
        ik.posture(grasp[7:], _weights(ARM_WEIGHT))
        return ik.solve(guess, "no room for the hands beside the object")

    def _held(
        self, guess: Array, posture: Array, hands: Frames, at: ObjectPose, quat: Array, arms: float,
        free: tuple[float, float], what: str, pelvis_m: float | None = None,
    ) -> Array:  # fmt: skip
        """Hands as they hold the object at `at`, which may be off by `free` [m], [rad].

        quat (4,): wished turn of the pelvis, xyzw; `pelvis_m`: its height, where that is demanded.
        """
        mass = self.task.grip.carried.mass_kg
        ik = self._standing(mass, at.p_WO)
        left, right = HANDS
        p_LR, R_LR = hands.R[0].T @ (hands.p[1] - hands.p[0]), hands.R[0].T @ hands.R[1]
        held = "hold of the object"
        ik.place(right, self._hand(1), self._hand(0) + p_LR, R_LR, held, HELD_M, HELD_RAD, seen_from=left)
        ik.place(left, self._hand(0), hands.p[0], hands.R[0], "object on its way", *free)
        for i, link in enumerate(HANDS):
            for off in (np.zeros(3), [AHEAD_M, 0.0, 0.0]):
                ik.point(link, self._hand(i) + off, hands.p[i] + hands.R[i] @ off, np.full(3, 140.0), np.eye(3))
        if self.task.grip.steps_back and at is self.task.lifted:
            self._low(ik)
        if pelvis_m is not None:
            inf = np.inf
            low, high = [-inf, -inf, pelvis_m - PELVIS_M], [inf, inf, pelvis_m + PELVIS_M]
            ik.within("pelvis", np.zeros(3), low, high, "pelvis at the height of the carry state")
        ik.pelvis_turn(np.roll(quat, 1), [2.0, 1.0, 1.0] if pelvis_m is None else np.full(3, 30.0))
        ik.posture(posture, _weights(arms))
        return ik.solve(guess, f"no configuration for {what}")

    def _standing(self, load_kg: float, p_load: Array) -> KeyframeIk:
        """A problem with the feet where they are, balance, and room for the knees."""
        task, ik = self.task, KeyframeIk(self.robot)
        for i, link in enumerate(FEET):
            ik.place(link, np.zeros(3), task.feet.p[i], task.feet.R[i], "foot on the floor")
        room = task.grip.support.near_m - KNEE_ROOM_M
        for link in KNEES:
            ik.within(link, np.zeros(3), np.full(3, -np.inf), [room, np.inf, np.inf], "knees off the support")
        ik.balance(COM_BOX_M, load_kg, p_load, "centre of mass over the feet")
        ik.centre(1.0, load_kg, p_load)
        return ik

    def _palms(self, ik: KeyframeIk, gap_m: Array, weight: float) -> None:
        """Every palm sphere `gap_m` (4,) off the object's side."""
        carried, pose, name = self.task.grip.carried, self.task.pose, "palms on the object"
        for i, link in enumerate(HANDS):
            for p_H, gap in zip(PALM_POINTS_M, gap_m, strict=True):
                p_F, off = self._hand(i) + p_H, PALM_RADIUS_M + gap
                if carried.shape == "box":
                    plane, inf = SIGN[i] * (carried.half_extents_m[1] + off), np.inf
                    low, high = [-inf, plane - PALM_GAP_M, -inf], [inf, plane + PALM_GAP_M, inf]
                    ik.within(link, p_F, low, high, name, pose.p_WO, pose.R_WO)
                    on_plane = pose.p_WO + pose.R_WO @ [0.0, plane, 0.0]
                    ik.point(link, p_F, on_plane, [0.0, weight, 0.0], pose.R_WO)
                else:
                    radius, gap_most = float(carried.half_extents_m[1]) + off, 0.5 * PALM_GAP_M
                    low, high = radius - gap_most, radius + gap_most
                    if carried.shape == "cylinder":
                        ik.off_axis(link, p_F, pose.p_WO, pose.R_WO[:, 2], low, high, name)
                    else:
                        ik.off_point(link, p_F, pose.p_WO, low, high, name)

    def _chest(self, ik: KeyframeIk) -> None:
        """The chest stays off the object: of a box each point off the face that it is farthest beyond already."""
        carried, pose, t = self.task.grip.carried, self.task.pose, self.terms
        half, inf = carried.half_extents_m, np.inf
        for p_P in CHEST_M:
            p_O = (t.p_WF[PELVIS] + t.R_WF[PELVIS] @ p_P - pose.p_WO) @ pose.R_WO
            name = "chest off the object"
            if carried.shape == "box":
                beyond = np.array([-p_O[0] - half[0], p_O[2] - half[2]])  # its front, its top
                low, high = np.full(3, -inf), np.full(3, inf)
                if beyond[0] > beyond[1]:
                    high[0] = -half[0] - CHEST_GAP_M
                else:
                    low[2] = half[2] + CHEST_GAP_M
                ik.within("pelvis", p_P, low, high, name, pose.p_WO, pose.R_WO)
            elif surface_distance(carried, p_O[None])[0][0] < 0.3:
                radius = float(half[1]) + CHEST_GAP_M
                if carried.shape == "sphere":
                    ik.off_point("pelvis", p_P, pose.p_WO, radius, inf, name)
                elif p_O[2] < half[2]:
                    ik.off_axis("pelvis", p_P, pose.p_WO, pose.R_WO[:, 2], radius, inf, name)

    def _low(self, ik: KeyframeIk) -> None:
        low, high = np.full(3, -np.inf), np.array([np.inf, np.inf, STEPPING_HEIGHT_M])
        ik.within("pelvis", np.zeros(3), low, high, "pelvis low enough to step")

    def _hand(self, side: int) -> Array:
        return self.robot.hand_m[side]


def _weights(arms: float) -> Array:
    weight = np.full(20, arms)
    weight[g1.LOWER] = LEG_WEIGHT
    return weight


def _rpy(terms: Terms, q: Array) -> Array:
    pin = terms._pin
    return pin.rpy.matrixToRpy(pin.Quaternion(q[3:7]).matrix())
