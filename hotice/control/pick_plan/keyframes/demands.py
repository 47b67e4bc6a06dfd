"""Constraints of the keyframes' inverse kinematics: a stance, palms beside the object, clearances."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hotice.control.pick_plan.grip import GRIP_AHEAD_M, PALM_POINTS_M, PALM_RADIUS_M
from hotice.control.pick_plan.keyframes.ik import KeyframeIk
from hotice.control.pick_plan.keyframes.robot import DrakeRobot
from hotice.control.pick_plan.task import CHEST_GAP_M, CHEST_M, KNEE_ROOM_M, STEPPING_HEIGHT_M, PickTask
from hotice.control.whole_body.terms import PELVIS, Terms
from hotice.model import g1
from hotice.model.carry import surface_distance

Array = NDArray[np.float64]
FEET = tuple(f"{side}_ankle_roll_link" for side in g1.SIDES)
HANDS = tuple(f"{side}_wrist_yaw_link" for side in g1.SIDES)
KNEES = tuple(f"{side}_knee_link" for side in g1.SIDES)
SIGN = (1.0, -1.0)
PALM_GAPS_M = {"box": (0.008,), "cylinder": (0.0005, 0.002, 0.004), "sphere": (0.0005, 0.002, 0.004)}
"""Distances of palm spheres from the surface that are allowed [m], tried one after another: locked wrists cannot make
palms perfectly flush. A cost does the rest; a cylinder would roll between palms of which only one pair of spheres
touches. Large spheres slip where more is demanded (trial 1 of `benchmarks.pickup --shape sphere --seed 1`): why is not
known."""


class Demands:
    """Demands of one task."""

    def __init__(self, task: PickTask, robot: DrakeRobot) -> None:
        self.task, self.robot = task, robot

    def standing(self, load_kg: float, p_load: Array) -> KeyframeIk:
        """A problem with the feet where they are, balance, and room for the knees."""
        task, ik = self.task, KeyframeIk(self.robot)
        for i, link in enumerate(FEET):
            ik.place(link, np.zeros(3), task.feet.p[i], task.feet.R[i], "foot on the floor")
        room = task.grip.support.near_m - KNEE_ROOM_M
        for link in KNEES:
            ik.within(link, np.zeros(3), np.full(3, -np.inf), [room, np.inf, np.inf], "knees off the support")
        ik.balance(task.com_box_m, load_kg, p_load, "centre of mass over the feet")
        ik.centre(1.0, load_kg, p_load)
        return ik

    def palms(self, ik: KeyframeIk, gap_m: Array, off_m: float, weight: float) -> None:
        """Every palm sphere `gap_m` (4,) off the object's side, within `off_m`; `weight` of the cost of being off."""
        carried, pose, name = self.task.grip.carried, self.task.pose, "palms on the object"
        for i, link in enumerate(HANDS):
            for p_H, gap in zip(PALM_POINTS_M, gap_m, strict=True):
                p_F, out = self.hand(i) + p_H, float(carried.half_extents_m[1]) + PALM_RADIUS_M + gap
                ahead = p_H[0] - GRIP_AHEAD_M
                aside = {"box": 0.0, "cylinder": ahead, "sphere": np.hypot(ahead, p_H[2])}[carried.shape]
                # where the sphere touches in the middle of the side
                plane, inf = (
                    SIGN[i] * np.sqrt(out**2 - aside**2),
                    np.inf,
                )
                ik.point(link, p_F, pose.p_WO + pose.R_WO @ [0.0, plane, 0.0], [0.0, weight, 0.0], pose.R_WO)
                if carried.shape == "box":
                    low, high = [-inf, plane - off_m, -inf], [inf, plane + off_m, inf]
                    ik.within(link, p_F, low, high, name, pose.p_WO, pose.R_WO)
                elif carried.shape == "cylinder":
                    ik.off_axis(link, p_F, pose.p_WO, pose.R_WO[:, 2], out - off_m, out + off_m, name)
                else:
                    ik.off_point(link, p_F, pose.p_WO, out - off_m, out + off_m, name)

    def chest(self, ik: KeyframeIk, terms: Terms) -> None:
        """The chest stays off the object: of a box each point off the face that it is farthest beyond by `terms`."""
        carried, pose, t = self.task.grip.carried, self.task.pose, terms
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

    def low(self, ik: KeyframeIk) -> None:
        """The pelvis is so low that the legs can step."""
        low, high = np.full(3, -np.inf), np.array([np.inf, np.inf, STEPPING_HEIGHT_M])
        ik.within("pelvis", np.zeros(3), low, high, "pelvis low enough to step")

    def hand(self, side: int) -> Array:
        """Origin of the hand frame in the frame of the wrist's link, (3,)."""
        return self.robot.hand_m[side]
