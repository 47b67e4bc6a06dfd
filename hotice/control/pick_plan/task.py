"""One pick: who stands where, and the places of the object from its support to the carry state, in G.

Frame G: origin on the floor between the feet, x ahead. The forearms stay level from grasp to carry, because locked
wrists turn an object with the forearm; the legs give the height.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hotice.control.pick_plan.grip import CLEAR_M, Grip
from hotice.control.whole_body.terms import FEET, HANDS, Terms
from hotice.model.frames import quat_from_yaw, quat_to_mat, yaw_from_quat

Array = NDArray[np.float64]
PREGRASP_GAP_M = 0.07
TIPS_M = np.array([[0.075, 0.0, -0.04], [-0.1, 0.0, -0.04]])  # of the hand frame: fingers and wrist, from below
TIPS_ABOVE_M = 0.05  # their way over the support
COM_BOX_M = np.array([[-0.035, -0.085], [0.05, 0.085]])
"""(2, 2) where the centre of mass may be: the soles, 17 cm by 20 cm and more, less a margin."""
CALM_COM_BOX_M = np.array([[-0.025, -0.025], [0.035, 0.025]])
"""The same for plans that are played back as position targets: servos at rest carry a body that leans by little."""
KNEE_ROOM_M = 0.07  # from the knee's axis to the edge of the support
CHEST_M = np.array([[0.079, y, z] for y in (-0.08, 0.08) for z in (0.0, 0.14, 0.27)])  # in P
CHEST_GAP_M = 0.02
STEPPING_HEIGHT_M = 0.755  # highest pelvis at which the legs are long enough to step


@dataclass(frozen=True, kw_only=True)
class ObjectPose:
    """Where the object is: p_WO (3,) [m], R_WO (3, 3)."""

    p_WO: Array
    R_WO: Array

    @classmethod
    def of(cls, p_WO: ArrayLike, quat_WO: ArrayLike) -> ObjectPose:
        """From a quaternion wxyz."""
        return cls(p_WO=np.array(p_WO, dtype=float), R_WO=np.asarray(quat_to_mat(quat_WO), dtype=np.float64))

    def towards(self, other: ObjectPose, share: float) -> ObjectPose:
        """Straight line and single turn about z."""
        (a, b), s = ([np.arctan2(o.R_WO[1, 0], o.R_WO[0, 0]) for o in (self, other)]), share
        return ObjectPose.of((1 - s) * self.p_WO + s * other.p_WO, quat_from_yaw((1 - s) * a + s * b))


@dataclass(frozen=True, kw_only=True)
class Frames:
    """Poses of a pair of frames, left and right, in G: p (2, 3) [m], R (2, 3, 3)."""

    p: Array
    R: Array

    def carried_along(self, before: ObjectPose, after: ObjectPose) -> Frames:
        """Where they come when they move with the object as if they were one body."""
        turn = after.R_WO @ before.R_WO.T
        return Frames(p=after.p_WO + (self.p - before.p_WO) @ turn.T, R=turn @ self.R)


@dataclass(frozen=True, kw_only=True)
class PickTask:
    """Demands on one plan.

    Attributes:
        q_start: (27,) standing. feet: their poses then. pose: the object before, upright; yaw: its turn [rad].
        com_box_m: (2, 2) where the common centre of mass may be, seen from the middle of the feet.
        lifted, final: the object above its support, and in the carry state. back_m: step back between the two.
    """

    grip: Grip
    q_start: Array
    feet: Frames
    pose: ObjectPose
    yaw: float
    com_box_m: Array = field(default_factory=COM_BOX_M.copy)
    lifted: ObjectPose = field(init=False)
    final: ObjectPose = field(init=False)
    back_m: float = field(init=False)

    def __post_init__(self) -> None:
        grip, pose = self.grip, self.pose
        back = 0.0
        if grip.steps_back:
            extent = np.abs(pose.R_WO[0]) @ grip.carried.half_extents_m
            back = float(pose.p_WO[0] + extent + CLEAR_M - grip.support.near_m)
        up = ObjectPose(p_WO=pose.p_WO + [0.0, 0.0, grip.rise_m], R_WO=pose.R_WO)
        end = ObjectPose(p_WO=grip.carry.object_pos_W, R_WO=np.eye(3))
        for name, value in (("lifted", up), ("final", end), ("back_m", back)):
            object.__setattr__(self, name, value)

    @classmethod
    def of(
        cls, grip: Grip, terms: Terms, q_start: Array, p_GO: Array, quat_GO: Array, com_box_m: Array = COM_BOX_M
    ) -> PickTask:
        """From a standing configuration (27,) and the object's pose; `terms` serve as scratch."""
        yaw = float(yaw_from_quat(quat_GO)) if grip.carried.shape == "box" else 0.0
        feet = frames_at(terms, q_start, FEET)
        pose = ObjectPose.of(p_GO, quat_from_yaw(yaw))
        return cls(grip=grip, q_start=q_start, feet=feet, pose=pose, yaw=yaw, com_box_m=com_box_m)


def frames_at(terms: Terms, q: Array, which: slice = HANDS) -> Frames:
    """Poses of hands or feet at a configuration (27,); `terms` serve as scratch."""
    terms.q[:], terms.v[:] = q, 0.0
    terms.refresh()
    return Frames(p=terms.p_WF[which].copy(), R=terms.R_WF[which].copy())
