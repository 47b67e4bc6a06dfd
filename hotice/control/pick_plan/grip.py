"""Grip of one object, wherever it stands: height of the palms, locked wrists, the carry state it ends in."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from hotice.control.pick_plan.plan import Support
from hotice.model import g1
from hotice.model.carry import CarryState, solve_carry
from hotice.model.objects import CarriedObject

Array = NDArray[np.float64]
GRASP_ABOVE_CENTRE_M = 0.055  # the object hangs from the palms: the higher they hold it, the less it tilts
SPHERE_BELOW_M = 0.02
"""Spheres are held that much below their centre, so that the palms also bear: palms above it press a sphere out
downwards."""
HIGHEST_GRASP_M = 1.03
GRIP_AHEAD_M = 0.04
TOE_IN_M = 0.0025
WRIST_IN_RAD = 0.06
"""Objects are held between the front of the palms, whose rear stays off, boxes by this much: locked wrists cannot make
palms perfectly flush, and which pair of palm spheres carries must be known, so that it can be put beside the centre of
mass."""
PALM_REACH_M = 0.16  # a palm further than this behind the near face is not asked for
PALM_POINTS_M = np.array([[sx * 0.04, 0.0, sz * 0.025] for sx in (-1, 1) for sz in (-1, 1)])
"""Centres of the palm spheres in the hand frame; a test holds them to g1.xml."""
PALM_RADIUS_M = 0.02
CLEAR_M = 0.03  # between object and support
READY_ARM = np.array([0.8, 0.6, 0.9, -0.7])  # left: hands wide and drawn back [rad]


@dataclass(frozen=True, kw_only=True)
class Grip:
    """Grip of one object from one support.

    Attributes:
        grasp_above_m: height of the palms above the object's centre, None: what suits object and support. An object
            that is held already is put down as it is held.
        above_m: height of the palms above the object's centre.
        place: (2, 3) middle of the palms in O. carry: where it ends; wrist_pos: (6,) locked wrists [rad].
        rise_m: how far the object is lifted. steps_back: whether the support is in the way of lowering it to the carry
            state.

    Raises `CarryInfeasible` where the object cannot be held.
    """

    carried: CarriedObject
    support: Support
    grasp_above_m: float | None = None
    above_m: float = field(init=False)
    grip_m: float = field(init=False)
    place: Array = field(init=False)
    carry: CarryState = field(init=False)
    wrist_pos: Array = field(init=False)
    rise_m: float = 2 * CLEAR_M
    steps_back: bool = field(init=False)

    def __post_init__(self) -> None:
        half, box, support = self.carried.half_extents_m, self.carried.shape == "box", self.support
        room = min(GRASP_ABOVE_CENTRE_M, half[2] - 0.05, HIGHEST_GRASP_M - support.top_m - half[2])
        above = -min(SPHERE_BELOW_M, half[2] - 0.09) if self.carried.shape == "sphere" else max(room, 0.02)
        if self.grasp_above_m is not None:
            above = self.grasp_above_m
        behind = min(-GRIP_AHEAD_M, PALM_REACH_M - half[0])
        carry = solve_carry(self.carried, grasp_height_m=above)
        p = carry.object_pos_W
        found = {
            "above_m": above,
            "grip_m": GRIP_AHEAD_M,
            "place": np.array([[behind, s * (half[1] + PALM_RADIUS_M), above] for s in (1.0, -1.0)]),
            "carry": carry,
            "wrist_pos": carry.wrist_pos + WRIST_IN_RAD * np.array([0, 0, -1.0, 0, 0, 1.0]) * box,
            "steps_back": bool(p[0] + half[0] + CLEAR_M > support.near_m and p[2] - half[2] < support.top_m + CLEAR_M),
        }
        for name, value in found.items():
            object.__setattr__(self, name, value)

    def gaps_m(self, off_m: float = 0.0) -> Array:
        """(4,) between palm spheres and object where the front pair is `off_m` off it: the rear pair stays off by more.

        Flat sides are met with the palms toed in. Beside round ones the palms are straight, and their front is at the
        widest.
        """
        if self.carried.shape == "box":
            rear = off_m + TOE_IN_M
        else:
            radius = float(self.carried.half_extents_m[1]) + PALM_RADIUS_M
            rear = float(np.hypot(radius + off_m, np.ptp(PALM_POINTS_M[:, 0]))) - radius
        return np.where(PALM_POINTS_M[:, 0] < 0, rear, off_m)


def ready_joints(carry: CarryState) -> Array:
    """Standing with the arms drawn back and apart, (20,) [rad]; the legs are those of the carry state."""
    joints = carry.joint_pos.copy()
    sign = g1.mirror_joints()[1][g1.UPPER][4:]
    joints[g1.UPPER] = np.concatenate([READY_ARM, sign * READY_ARM])
    return joints
