"""Contacts within the robot: few pairs of primitives, enough that no limb passes through another.

Legs against each other, arms and hands against legs, trunk, head and each other, knees against the trunk. Pairs that
their joints keep apart are left out. Contacts within the robot carry no friction, which costs one constraint row
instead of four; they are counted in evaluations (`depth`) and end no episode.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import mujoco
import numpy as np

LEG = ("hip_yaw_link_0", "knee_link_0", "knee_link_1", "ankle_roll_link_0")
"""Thigh, knee and upper shin, lower shin, foot; each after its side."""
ARM = ("elbow_link_0", "wrist_pitch_link_0", "wrist_yaw_link_1", "wrist_yaw_link_2")
"""Forearm, wrist, hand, fingers."""
TRUNK = ("pelvis_0", "torso_link_0", "torso_link_3")
"""Pelvis, chest, head."""
FRICTION = (1e-5,) * 5


def pairs() -> list[tuple[str, str]]:
    """Names of the geoms of each pair, as in the robot's description."""
    left_leg, right_leg = ([f"{side}_{part}" for part in LEG] for side in ("left", "right"))
    left_arm, right_arm = ([f"{side}_{part}" for part in ARM] for side in ("left", "right"))
    arms, legs = left_arm + right_arm, left_leg + right_leg
    knees = [name for name in legs if name.endswith("knee_link_0")]
    return [
        *product(left_leg, right_leg),
        *product(left_arm, right_arm),
        *product(arms, legs),
        *product(arms, TRUNK),
        *product(knees, ("torso_link_0",)),
    ]


def add_self_contact(spec: mujoco.MjSpec) -> None:
    """Makes every pair of `pairs` a contact pair of a robot's specification."""
    for one, other in pairs():
        spec.add_pair(geomname1=one, geomname2=other, condim=1, friction=FRICTION)


def depth(model: mujoco.MjModel, data: mujoco.MjData, names: Sequence[tuple[str, str]] | None = None) -> float:
    """Largest depth to which `names` (default: all pairs) intrude into each other [m]; 0 where none do."""
    fromto = np.empty(6)
    gaps = [
        mujoco.mj_geomDistance(model, data, model.geom(one).id, model.geom(other).id, 0.05, fromto)
        for one, other in names or pairs()
    ]
    return max(0.0, -min(gaps))
