"""Tracking of a pick-up's reference: tasks and contacts of the whole-body QP."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hotice.control.pickup.memory import Motion, PickupMemory
from hotice.control.whole_body.contacts import Contacts
from hotice.control.whole_body.tasks import Targets
from hotice.control.whole_body.terms import FEET, HANDS, LEFT_HAND, PELVIS, Terms
from hotice.model import g1
from hotice.model.frames import GRAVITY, quat_from_yaw, quat_to_mat
from hotice.model.objects import CarriedObject

Array = NDArray[np.float64]
STANDING_N = 400.0
TURN_N_M, TURN_NS_M = 1500.0, 60.0
ROLL_NM, ROLL_NMS = np.array([5.0, 40.0, 40.0]), 1.0
"""Stiffness of palms on round sides about the axes of the hand: soft about x, because a pair of palm spheres, one above
the other, aligns itself; a stiff palm loads one of the two, about which the object then swings."""
BEARS_M, INWARD = 0.03, (1.0, -1.0)
"""The weight of round objects bears on the skin of the palms, that far inward of the points at which they press (chosen
on heavy spheres). Without its moment the lower of two palm spheres is unloaded, until the object swings about the upper
one."""


class Tracking:
    """Writes `targets` and `contacts`; `true`: terms of the measured state, `ref`: terms of the reference."""

    def __init__(self, carried: CarriedObject, squeeze_n: float, true: Terms, ref: Terms) -> None:
        self.targets, self.contacts = Targets(), Contacts()
        self._carried, self._squeeze_n, self._true, self._ref = carried, squeeze_n, true, ref
        t = self.targets
        t.gain_com([20.0, 20.0, 0.0], 5.0)
        t.gain_frame("pelvis", [0.0, 0.0, 20.0, 10.0, 10.0, 10.0], 7.0)
        t.gain_joints(np.where(np.arange(20) < g1.LOWER.stop, 0.02, 1.0), 12.0)
        for hand in ("left_hand", "right_hand"):
            t.gain_frame(hand, [4.0, 4.0, 4.0, 2.0, 2.0, 0.0], 12.0)
        for foot in ("left_foot", "right_foot"):  # of a foot in the air
            t.gain_frame(foot, 30.0, 16.0)

    def follow(self, memory: PickupMemory, motion: Motion) -> None:
        """Targets and forces of this step."""
        ref, t, k = self._ref, self.targets, self.contacts
        ref.q[:], ref.v[:] = memory.reference, motion.rate
        ref.refresh()
        t.com_pos[:], t.com_vel[:], t.com_acc[:] = ref.com, ref.v_com, motion.com_acc
        for f in (PELVIS, HANDS):
            t.frame_pos[f], t.frame_rot[f], t.frame_vel[f] = ref.p_WF[f], ref.R_WF[f], ref.v_WF[f]
        t.joint_pos[:], t.joint_vel[:] = ref.q[g1.JOINT_POS], ref.v[g1.JOINT_VEL]
        k.foot_force_max_n[:] = STANDING_N
        if memory.air.any() and motion.feet is not None:
            k.foot_force_max_n[memory.air] = 0.0
            pose, velocity = motion.feet.pose, motion.feet.velocity
            t.frame_pos[FEET], t.frame_vel[FEET, :3], t.frame_vel[FEET, 5] = (
                pose[:, :3],
                velocity[:, :3],
                velocity[:, 3],
            )
            t.frame_rot[FEET] = quat_to_mat(quat_from_yaw(pose[:, 3]))
        self._press(memory)
        k.hand_force_max_n[:] = 2.0 * self._squeeze_n if memory.squeeze_n > 0 else 0.0
        k.load_kg = memory.load_share * self._carried.mass_kg
        k.hand_moment_W[:] = 0.0
        if memory.plan is not None:
            k.hand_point[:] = memory.plan.hand_point
            if k.load_kg > 0.0:
                self._bear(memory, memory.plan.p_HO)

    def _press(self, memory: PickupMemory) -> None:
        """Target forces of the hands along the line between the palms as they are: no moment on the object."""
        ref, true, k = self._ref, self._true, self.contacts
        point = k.hand_point if memory.plan is None else memory.plan.hand_point
        press = true.p_WF[HANDS] + np.einsum("hij,hj->hi", true.R_WF[HANDS], point)
        line = press[0] - press[1]
        line /= np.linalg.norm(line)
        k.hand_normal_W[0], k.hand_normal_W[1] = line, -line
        k.hand_force_ref_W[:] = memory.squeeze_n * k.hand_normal_W
        if memory.load_share > 0.0:  # stiffer against turning the object than the light arms are by their tasks
            off, rate = true.p_WF[HANDS] - ref.p_WF[HANDS], true.v_WF[HANDS, :3] - ref.v_WF[HANDS, :3]
            turn = 0.5 * memory.load_share * (TURN_N_M * (off[0] - off[1]) + TURN_NS_M * (rate[0] - rate[1]))
            turn -= (turn @ line) * line
            k.hand_force_ref_W[0] += turn
            k.hand_force_ref_W[1] -= turn

    def _bear(self, memory: PickupMemory, p_HO: Array) -> None:
        """Moments of a load whose centre is not between the points at which the palms press."""
        ref, true, k = self._ref, self._true, self.contacts
        weight = 0.5 * k.load_kg * GRAVITY
        for hand, R in enumerate(true.R_WF[HANDS]):
            f = LEFT_HAND + hand
            ahead = R @ (p_HO[hand] - k.hand_point[hand])
            k.hand_moment_W[hand, 1] = ahead[0] * weight
            if self._carried.shape != "box":  # flat sides turn the palms, round ones let them roll
                k.hand_moment_W[hand] += (BEARS_M * weight * INWARD[hand]) * R[:, 0]
                E = ref.R_WF[f] @ R.T
                off = 0.5 * np.array([E[2, 1] - E[1, 2], E[0, 2] - E[2, 0], E[1, 0] - E[0, 1]])
                spin = ref.v_WF[f, 3:] - true.v_WF[f, 3:]
                k.hand_moment_W[hand] -= memory.load_share * (R @ (ROLL_NM * (R.T @ off)) + ROLL_NMS * spin)
