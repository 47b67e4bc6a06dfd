"""The policy's observation in numpy: the twin of `hotice.sim.observations.POLICY`, one robot at a time.

Vectors are in the yaw frame Y or the pelvis frame P. A test holds it equal to the environment's to 1e-5.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hotice.fields.alignment import observed
from hotice.model.carry import CarryState
from hotice.model.frames import rotation_z
from hotice.policy.guidance import NUM_FIELD, FieldReading
from hotice.policy.percept import NUM_SGF, Percept
from hotice.task import history
from hotice.task.policy_task import PolicyTask
from hotice.task.scan import NUM_SCAN, nearness

Array = NDArray[np.float64]
LAYOUT: tuple[tuple[str, int], ...] = (
    ("gyro", 3),
    ("gravity", 3),
    ("joint_pos", 20),
    ("joint_vel", 20),
    ("carry_pos", 20),
    ("last_action", 20),
    ("clock", 2),
    ("command", 6),
    ("object_pose", 9),
    ("object_size", 3),
    ("sgf", 5 * NUM_SGF),
    ("ogf", 5 * (NUM_FIELD - NUM_SGF)),
)
"""Names and widths of the rows, in order, of a policy without the local obstacle scan and without a history."""
SIZE = sum(width for _, width in LAYOUT)


def layout_of(task: PolicyTask) -> tuple[tuple[str, int], ...]:
    """Names and widths of the rows that a policy for this task reads."""
    rows = (*LAYOUT, ("scan", NUM_SCAN)) if task.scan else LAYOUT
    return (*rows, ("history", task.history * history.FRAME)) if task.history else rows


_ENDS = dict(zip((name for name, _ in LAYOUT), np.cumsum([width for _, width in LAYOUT]), strict=True))
_FRAME = np.concatenate([np.arange(_ENDS[name] - width, _ENDS[name]) for name, width in history.ROWS])


def remember(past: Array, observation: NDArray[np.float32]) -> Array:
    """The past (H,) one step later, when `observation` is over; zeros (H,) are the past of the first step."""
    return np.concatenate([observation.take(_FRAME), past], dtype=np.float64)[: len(past)]


@dataclass(frozen=True, kw_only=True, eq=False)
class Carrying:
    """Carried object and grasp: joint_pos (20,) of the carry state [rad], half_extents (3,) of the object [m]."""

    joint_pos: Array
    half_extents: Array

    @classmethod
    def of(cls, state: CarryState) -> Carrying:
        """From a carry state."""
        return cls(joint_pos=state.joint_pos, half_extents=state.carried.half_extents_m)


def observe(
    percept: Percept, reading: FieldReading, carrying: Carrying, action: Array, phase: float, scan: bool, past: Array
) -> NDArray[np.float32]:
    """Observation (201,), with the local obstacle scan 40 more, with a history H more, for one step.

    `action` (20,) is the last one, `phase` [rad] the step clock of the left leg; `scan`: whether the policy reads the
    scan; `past` (H,): what it read in the steps before, see `remember`.
    """
    R_WY = rotation_z(float(percept.yaw[0]))  # v_Y = v_W @ R_WY; `dot` is the same in half the time
    error, p_WP = float(reading.heading_error[0]), percept.p_WP
    goal = math.tanh(float(reading.goal_distance[0]))
    clock_and_command = (math.sin(phase), math.cos(phase), *reading.c_W.dot(R_WY).tolist())
    rows = (
        0.25 * percept.w_WP_P,
        percept.gravity_P,
        percept.q - carrying.joint_pos,
        0.1 * percept.qd,
        carrying.joint_pos,
        action,
        (*clock_and_command, math.sin(error), math.cos(error), goal),
        (percept.p_WO - p_WP).dot(R_WY),
        percept.R_WO[:, :2].T.dot(R_WY).ravel(),
        5.0 * carrying.half_extents,
        observed(reading.force_W.dot(R_WY), reading.distance).ravel(),
        *((nearness(reading.scan),) if scan else ()),
        past,
    )
    return np.concatenate(rows, dtype=np.float32, casting="same_kind")
