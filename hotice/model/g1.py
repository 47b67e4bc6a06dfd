"""The Unitree G1 by name: joints, the 12 + 8 action split, gains, limits and potential-field keypoints.

Everything else asks this module; no other module spells a joint name or counts degrees of freedom.
Sources: joint order and limits of Unitree's published description; gains, torque limits and armature from public G1
controllers (CAT, FALCON); keypoints from the paper, section IV-A.
"""

from __future__ import annotations

from collections.abc import Sequence
from importlib.resources import files

import numpy as np

from hotice.errors import UnknownName

__all__ = [
    "ACTION_JOINTS",
    "ALL_JOINTS",
    "ARM_JOINTS",
    "LEG_JOINTS",
    "LOCKED_JOINTS",
    "LOWER",
    "OGF_KEYPOINTS",
    "SGF_KEYPOINTS",
    "SIDES",
    "UPPER",
    "WAIST_JOINTS",
    "WRIST_JOINTS",
    "gains",
    "mirror_joints",
    "xml_path",
]

SIDES = ("left", "right")
ROOT_BODY = "pelvis"
TORSO_BODY = "torso_link"
STANDING_HEIGHT_M = 0.793  # pelvis above the floor with straight legs

_LEG = ("hip_pitch", "hip_roll", "hip_yaw", "knee", "ankle_pitch", "ankle_roll")
_ARM = ("shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow")
_WRIST = ("wrist_roll", "wrist_pitch", "wrist_yaw")

LEG_JOINTS = tuple(f"{side}_{j}_joint" for side in SIDES for j in _LEG)
WAIST_JOINTS = ("waist_yaw_joint", "waist_roll_joint", "waist_pitch_joint")
ARM_JOINTS = tuple(f"{side}_{j}_joint" for side in SIDES for j in _ARM)
WRIST_JOINTS = tuple(f"{side}_{j}_joint" for side in SIDES for j in _WRIST)

ACTION_JOINTS = LEG_JOINTS + ARM_JOINTS
"""The 20 joints the policy commands, in action order: a = [a_low (12), a_up (8)] (paper, section IV-B)."""
LOWER = slice(0, len(LEG_JOINTS))
UPPER = slice(len(LEG_JOINTS), len(ACTION_JOINTS))
ACTIONS = len(ACTION_JOINTS)

# Configuration and velocity of the robot with a free root and the joints of `ACTION_JOINTS`, in MuJoCo (quaternion
# wxyz) and Pinocchio (xyzw, and the root's velocity in P); all joints have the root in the same place.
ROOT_POS, ROOT_QUAT, JOINT_POS = slice(0, 3), slice(3, 7), slice(7, 7 + ACTIONS)
ROOT_VEL, ROOT_RATE, JOINT_VEL = slice(0, 3), slice(3, 6), slice(6, 6 + ACTIONS)

# what a MuJoCo model with an object has behind them
OBJECT_POS, OBJECT_QUAT = slice(JOINT_POS.stop, JOINT_POS.stop + 3), slice(JOINT_POS.stop + 3, JOINT_POS.stop + 7)
OBJECT_VEL, OBJECT_RATE = slice(JOINT_VEL.stop, JOINT_VEL.stop + 3), slice(JOINT_VEL.stop + 3, JOINT_VEL.stop + 6)

ALL_JOINTS = LEG_JOINTS + WAIST_JOINTS + tuple(f"{side}_{j}_joint" for side in SIDES for j in _ARM + _WRIST)
"""The 29 joints in the order of the published description."""
LOCKED_JOINTS = tuple(j for j in ALL_JOINTS if j not in ACTION_JOINTS)
"""Waist and wrists: welded in the 20-joint model, held by stiff servos in the 29-joint one."""

WRIST_LINKS = tuple(j.replace("_joint", "_link") for j in WRIST_JOINTS)
WRIST_AXES = {"wrist_roll": (1.0, 0.0, 0.0), "wrist_pitch": (0.0, 1.0, 0.0), "wrist_yaw": (0.0, 0.0, 1.0)}

# servo gains by the end of the joint name: kp [N m/rad], kd [N m s/rad]
_GAINS = {
    "hip_pitch": (100.0, 2.0),
    "hip_roll": (100.0, 2.0),
    "hip_yaw": (100.0, 2.0),
    "knee": (200.0, 4.0),
    "ankle_pitch": (80.0, 2.0),
    "ankle_roll": (20.0, 1.0),
    "shoulder_pitch": (90.0, 2.0),
    "shoulder_roll": (60.0, 2.0),
    "shoulder_yaw": (20.0, 1.0),
    "elbow": (60.0, 1.0),
    "waist_yaw": (400.0, 5.0),
    "waist_roll": (400.0, 5.0),
    "waist_pitch": (400.0, 5.0),
    "wrist_roll": (60.0, 1.0),
    "wrist_pitch": (60.0, 1.0),
    "wrist_yaw": (60.0, 1.0),
}

SGF_KEYPOINTS = (
    "head",
    "left_shoulder",
    "right_shoulder",
    "torso",
    "pelvis",
    "left_knee",
    "right_knee",
    "left_foot",
    "right_foot",
)
"""Keypoints that read the Standard Guidance Field: head, shoulders, torso, root, knees, feet (paper, IV-A)."""
STEERED_KEYPOINTS = ("head", "pelvis", "left_foot", "right_foot")
"""Keypoints whose velocity is rewarded along the Standard Guidance Field, and whose vectors make the command c."""
OGF_KEYPOINTS = ("left_hand", "right_hand")
"""Robot keypoints that read the Object-Centric Guidance Field; the object adds its own eight."""
FOOT_ENDS = ("left_toe", "right_toe", "left_heel", "right_heel")


def xml_path() -> str:
    """Path of the 29-joint MJCF text that MuJoCo, Pinocchio and Drake read."""
    return str(files("hotice.model") / "g1.xml")


def stem(joint: str) -> str:
    """Joint name without side and suffix: `left_knee_joint` -> `knee`."""
    return joint.removesuffix("_joint").removeprefix("left_").removeprefix("right_")


def gains(joints: Sequence[str] = ACTION_JOINTS) -> tuple[np.ndarray, np.ndarray]:
    """Servo gains of the named joints: kp [N m/rad] and kd [N m s/rad], each (J,)."""
    for joint in joints:
        if joint not in ALL_JOINTS:
            raise UnknownName("joint", joint, ALL_JOINTS)
    kp, kd = zip(*(_GAINS[stem(j)] for j in joints), strict=True)
    return np.array(kp), np.array(kd)


def mirror_joints(joints: Sequence[str] = ACTION_JOINTS) -> tuple[np.ndarray, np.ndarray]:
    """Reflection of joint coordinates in the sagittal plane: q_mirrored = sign * q[index].

    Returns:
        index: (J,) the joint of the other side; sign: (J,) −1 for roll and yaw axes, +1 for pitch axes.
    """
    other = {"left": "right", "right": "left"}
    index, sign = [], []
    for joint in joints:
        side = joint.split("_", 1)[0]
        index.append(list(joints).index(joint.replace(side, other[side], 1) if side in other else joint))
        sign.append(-1.0 if stem(joint).endswith(("roll", "yaw")) else 1.0)
    return np.array(index), np.array(sign)
