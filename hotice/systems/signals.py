"""Layouts of the vectors that go through more than one port.

`robot_state` (84,): `RobotState.to_mujoco(29)` of the robot with its object, whatever simulates it:

| Part | Size | Content |
|---|---|---|
| qpos | 43 | p_WP [m], quat_WP wxyz, 29 joint angles [rad] (`g1.ALL_JOINTS`), p_WO [m], quat_WO wxyz |
| qvel | 41 | v_WP [m/s] in W, w_WP [rad/s] in P, 29 joint velocities, v_WO in W, w_WO in O |

`joint_target` and `torque` (20,): order `g1.ACTION_JOINTS`, [rad] and [N m].
`percept` (119,) and `guidance` (122,): the vectors of `Percept` and `FieldReading` in `hotice.policy`.
`status` (2,) of a controller: when it made its newest command [s] (NaN: not yet), and the `Fault` that it met then.
`answer` (2,) of the safety monitor: the `Answer` and the `Fault` that asks for it.
`sources` (4,) of what is seen: when the pelvis' and the object's newest accepted poses were made [s], and the `Fault`
that each had last, 0 for none.
`contact_force` (12,): of the world and the object on left foot, right foot, left hand, right hand, in W [N].
"""

from __future__ import annotations

from hotice.model import g1
from hotice.model.robot_state import joint_index
from hotice.policy.guidance import FieldReading
from hotice.policy.percept import Percept

NUM_JOINTS = len(g1.ACTION_JOINTS)
NQ, NV = 43, 41
ROBOT_STATE = NQ + NV
PERCEPT, GUIDANCE = Percept.SIZE, FieldReading.SIZE
CONTACT_FORCE = 12
STATUS = ANSWER = 2
SOURCES, STAMPS = 4, 2
OBJECT_POS, OBJECT_QUAT = slice(36, 39), slice(39, 43)
ROOT_VEL, ROOT_RATE = slice(NQ, NQ + 3), slice(NQ + 3, NQ + 6)
OBJECT_VEL, OBJECT_RATE = slice(NQ + 35, NQ + 38), slice(NQ + 38, NQ + 41)
"""Where the object, and the velocities of root and object, are in `robot_state`; the root is where `g1` says."""
JOINT_POS = 7 + joint_index(20)
"""Where the 20 actuated joint angles are in `robot_state`, (20,)."""
JOINT_VEL = NQ + 6 + joint_index(20)
"""Where their velocities are, (20,)."""
TOUCHING_BODIES = tuple(f"{side}_{link}" for link in ("ankle_roll_link", "wrist_yaw_link") for side in g1.SIDES)
"""Bodies of the four parts of `contact_force`."""
