"""The observation tables: what both actors read (the robot's own sensing) and what the critics see beside it.

Vectors are in the yaw frame Y or the pelvis frame P, so that heading and place in the world do not matter. Every row
says how it reflects in the sagittal plane, which gives the mirror symmetry of the whole observation for free.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from hotice.errors import InvalidConfig
from hotice.fields.alignment import observed
from hotice.fields.bank import FieldSample
from hotice.model import g1
from hotice.model.objects import OCTANTS
from hotice.sim.snapshot import FOOT_ENDS, Snapshot
from hotice.task import history
from hotice.task.scan import BODY_POINTS, FOOT_POINTS, nearness

Mirror = tuple[np.ndarray, np.ndarray]
"""index (D,), sign (D,): mirrored = sign * value[index]."""

VECTOR = (np.arange(3), np.array([1.0, -1.0, 1.0]))
PSEUDO = (np.arange(3), np.array([-1.0, 1.0, -1.0]))
_OTHER_SIDE = [
    g1.SGF_KEYPOINTS.index(k.replace("left", "#").replace("right", "left").replace("#", "right"))
    for k in g1.SGF_KEYPOINTS
]
_OTHER_CORNER = [int(np.flatnonzero((OCTANTS == o * [1, -1, 1]).all(axis=1))[0]) for o in OCTANTS]


def same(size: int) -> Mirror:
    """A row that does not change."""
    return np.arange(size), np.ones(size)


def swap(order: Sequence[int], inner: Mirror) -> Mirror:
    """Items in another order, each reflected like `inner`."""
    size = len(inner[0])
    index = np.concatenate([size * item + inner[0] for item in order])
    return index, np.tile(inner[1], len(order))


def chain(*parts: Mirror) -> Mirror:
    """Rows one after the other."""
    offsets = np.cumsum([0, *(len(p[0]) for p in parts)])
    return np.concatenate([p[0] + o for p, o in zip(parts, offsets, strict=False)]), np.concatenate(
        [p[1] for p in parts]
    )


@dataclass(frozen=True)
class Observation:
    """A row: function (N, D) of a snapshot, its reflection, and what it is."""

    name: str
    value: Callable[[Any], Tensor]
    mirror: Mirror
    note: str


def _field(s: Snapshot, sample: FieldSample) -> Tensor:
    """Unit direction in Y, squashed size and clipped distance of each keypoint, (N, 5 K)."""
    return observed(s.to_yaw_frame(sample.force_W), sample.signed_distance).flatten(1)


def _object_pose(s: Snapshot) -> Tensor:
    """Position and two columns of the orientation of the object in Y, (N, 9)."""
    columns = s.to_yaw_frame(s.R_WO[:, :, :2].transpose(1, 2))
    return torch.cat([s.to_yaw_frame(s.p_WO - s.p_WP), columns.flatten(1)], dim=1)


def _command(s: Snapshot) -> Tensor:
    """C in Y [m/s], sine and cosine of the heading error, distance to go (squashed), (N, 6)."""
    error = s.heading_error
    togo = torch.tanh(s.goal_distance)
    return torch.cat([s.to_yaw_frame(s.c_W), torch.stack([torch.sin(error), torch.cos(error), togo], dim=1)], dim=1)


_JOINTS = g1.mirror_joints()
_CODE = chain(VECTOR, same(2))
_FIELD_SGF = swap(_OTHER_SIDE, _CODE)
_FIELD_OGF = chain(swap([1, 0], _CODE), swap(_OTHER_CORNER, _CODE))
_POSE = chain(VECTOR, VECTOR, (np.arange(3), np.array([-1.0, 1.0, -1.0])))

POLICY: tuple[Observation, ...] = (
    Observation("gyro", lambda s: 0.25 * s.w_WP_P, PSEUDO, "angular velocity of the pelvis, in P, × 0.25"),
    Observation("gravity", lambda s: s.gravity_P, VECTOR, "gravity direction in P"),
    Observation("joint_pos", lambda s: s.q - s.grasp.joint_pos, _JOINTS, "20 joint angles from the carry state"),
    Observation("joint_vel", lambda s: 0.1 * s.qd, _JOINTS, "20 joint velocities, × 0.1"),
    Observation("carry_pos", lambda s: s.grasp.joint_pos, _JOINTS, "20 joint angles of the carry state"),
    Observation("last_action", lambda s: s.action, _JOINTS, "20 actions"),
    Observation(
        "clock",
        lambda s: torch.stack([torch.sin(s.phase), torch.cos(s.phase)], dim=1),
        (np.arange(2), -np.ones(2)),
        "step clock of the left leg",
    ),
    Observation(
        "command",
        _command,
        chain(VECTOR, (np.arange(3), np.array([-1.0, 1.0, 1.0]))),
        "c in Y, sine and cosine of the heading error, squashed distance to go",
    ),
    Observation("object_pose", _object_pose, _POSE, "position from the pelvis and two axes of the object, in Y"),
    Observation("object_size", lambda s: 5.0 * s.grasp.half_extents, same(3), "half extents, × 5"),
    Observation("sgf", lambda s: _field(s, s.sgf), _FIELD_SGF, "Standard Guidance Field at nine keypoints"),
    Observation("ogf", lambda s: _field(s, s.ogf), _FIELD_OGF, "Object-Centric Guidance Field at hands and object"),
)

SCAN = Observation(
    "scan",
    lambda s: nearness(s.scan),
    chain(swap([1, 0], same(len(FOOT_POINTS))), same(len(BODY_POINTS))),
    "nearness of obstacles ahead of feet and body, where the task has the scan",
)


_FRAME = chain(PSEUDO, VECTOR, _JOINTS, _JOINTS, _JOINTS)


def past_rows(steps: int) -> Observation:
    """Readings of the last `steps` control steps, the newest first; zero before the episode began."""
    return Observation(
        "history",
        lambda s: s.past,
        chain(*[_FRAME] * steps),
        f"{' '.join(name for name, _ in history.ROWS)} as read in each of the last {steps} steps",
    )


def policy_rows(scan: bool, history_steps: int = 0) -> tuple[Observation, ...]:
    """Rows that the actors read: `POLICY`, and the local obstacle scan and the past where the task has them."""
    rows = (*POLICY, SCAN) if scan else POLICY
    return (*rows, past_rows(history_steps)) if history_steps else rows


PRIVILEGED: tuple[Observation, ...] = (
    Observation("root_velocity", lambda s: s.to_yaw_frame(s.v_WP), VECTOR, "pelvis velocity in Y"),
    Observation("root_height", lambda s: 5.0 * (s.p_WP[:, 2:] - 0.74), same(1), "pelvis height over 0.74 m, × 5"),
    Observation("touch", lambda s: s.touch.float(), (np.array([1, 0]), np.ones(2)), "soles on the floor"),
    Observation(
        "foot_heights",
        lambda s: 10.0 * s.p_WK[:, FOOT_ENDS, 2],
        (np.array([1, 0, 3, 2]), np.ones(4)),
        "heights of toes and heels, × 10",
    ),
    Observation("object_velocity", lambda s: s.to_yaw_frame(s.v_WO - s.v_WP), VECTOR, "relative to the pelvis, in Y"),
    Observation("object_spin", lambda s: 0.25 * s.to_yaw_frame(s.w_WO), PSEUDO, "angular velocity in Y, × 0.25"),
    Observation("object_mass", lambda s: s.grasp.mass, same(1), "mass [kg]"),
    Observation("goal", lambda s: s.goal_Y, (np.arange(2), np.array([1.0, -1.0])), "goal in Y"),
    Observation("time_left", lambda s: s.time_left[:, None], same(1), "share of the episode that is left"),
    Observation("torque", lambda s: s.torque / 50.0, _JOINTS, "servo torques, / 50 N m"),
    Observation(
        "clearance",
        lambda s: 5.0 * torch.clamp(torch.stack([s.clearance, s.object_clearance], dim=1), -0.1, 0.4),
        same(2),
        "gaps from robot and object to obstacles, clipped, × 5",
    ),
)


class ObservationTable:
    """Evaluates rows side by side, (N, D), and reflects the result."""

    def __init__(self, rows: Sequence[Observation]) -> None:
        names = [r.name for r in rows]
        if len(set(names)) != len(names):
            raise InvalidConfig(f"observation name {next(n for n in names if names.count(n) > 1)!r} occurs twice")
        self.rows = tuple(rows)
        self.size = sum(len(r.mirror[0]) for r in rows)
        index, sign = chain(*(r.mirror for r in rows))
        self.mirror_index = torch.tensor(index)
        self.mirror_sign = torch.tensor(sign, dtype=torch.float32)

    def __call__(self, s: Any) -> Tensor:
        return torch.cat([row.value(s) for row in self.rows], dim=1)

    def columns(self, names: Sequence[str]) -> Tensor:
        """Mask (D,) of the columns that belong to the named rows."""
        return torch.cat([torch.full((len(r.mirror[0]),), r.name in names) for r in self.rows])

    def layout(self) -> list[tuple[str, int]]:
        """Names and widths in order: what a stored policy is checked against."""
        return [(r.name, len(r.mirror[0])) for r in self.rows]

    def mirror(self, observation: Tensor) -> Tensor:
        """The observation of the mirrored situation, (N, D) -> (N, D)."""
        index, sign = self.mirror_index.to(observation.device), self.mirror_sign.to(observation.device)
        return observation[:, index] * sign


ACTION_MIRROR = tuple(torch.tensor(a) for a in (_JOINTS[0], _JOINTS[1].astype(np.float32)))


def mirror_action(action: Tensor) -> Tensor:
    """The action of the mirrored situation, (N, 20) -> (N, 20)."""
    index, sign = (t.to(action.device) for t in ACTION_MIRROR)
    return action[:, index] * sign
