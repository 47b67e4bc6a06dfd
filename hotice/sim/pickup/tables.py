"""Tables of the pick-up: rewards, observations, ends."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from hotice.model import g1
from hotice.model.picks.book import BOOK_PHASES
from hotice.sim import observations as seen
from hotice.sim import terms as common
from hotice.sim.observations import VECTOR, Observation, chain, same, swap
from hotice.sim.pickup import terms
from hotice.sim.pickup.snapshot import PickSnapshot
from hotice.sim.rewards import L, Reward, S, U
from hotice.sim.snapshot import HANDS
from hotice.sim.terminations import Termination, fall
from hotice.task import rules

REWARDS: tuple[Reward, ...] = (
    Reward("lifted", S, 1.0, terms.lifted, "ours"),
    Reward("near_carry", S, 1.0, terms.near_carry, "ours"),
    Reward("in_carry", S, 1.0, terms.in_carry, "ours"),
    Reward("follow_legs", L, 1.0, terms.follow_legs, "ours, the plan"),
    Reward("over_feet", L, 1.0, terms.over_feet, "ours, the plan"),
    Reward("feet_stay", L, -1.0, terms.feet_stay, "ours"),
    Reward("upright", L, -0.5, common.upright, "CAT"),
    Reward("root_rocking", L, -0.08, common.root_rocking, "CAT"),
    Reward("foot_slip", L, -0.4, common.foot_slip, "CAT"),
    Reward("leg_smoothness", L, -0.03, common.leg_smoothness, "CAT"),
    Reward("leg_torque", L, -0.04, common.leg_torque, "CAT"),
    Reward("follow_arms", U, 1.0, terms.follow_arms, "ours, the plan"),
    Reward("object_turned", U, -1.0, terms.object_turned, "ours"),
    Reward("grip_slip", U, -0.5, terms.grip_slip, "paper IV-B"),
    Reward("arm_smoothness", U, -0.03, common.arm_smoothness, "CAT"),
)


def drop(s: PickSnapshot) -> Tensor:
    """The object is below its support, or, after the lift, dropped (`hotice.task.rules.dropped`)."""
    apart = (s.p_WO - s.p_WK[:, HANDS].mean(dim=1)).norm(dim=-1)
    return (s.above < -0.05) | (rules.dropped(apart, s.p_WO[:, 2]) & (s.phase > terms.LIFT))


TERMINATIONS: tuple[Termination, ...] = (
    Termination("fall", fall),
    Termination("drop", drop),
    Termination("robot_collision", lambda s: s.robot_hit, collision=True),
)
"""`robot_collision`: the robot touches, and on a real floor would push, the support."""


def _clock(s: PickSnapshot) -> Tensor:
    """One column for each phase, 1 where it is now, and the share of it that is over, (N, 9)."""
    now = torch.nn.functional.one_hot(s.phase, len(BOOK_PHASES)).float()
    return torch.cat([now, s.share[:, None]], dim=1)


FELT_SCALE = 10.0
"""Of the offset in the row `felt`; its rate is read as it is."""
_WRISTS = swap([1, 0], (np.arange(3), np.array([-1.0, 1.0, -1.0])))
_JOINTS = g1.mirror_joints()
_PLANE = (np.arange(2), np.array([1.0, -1.0]))
_OWN = {row.name: row for row in seen.POLICY}

POLICY: tuple[Observation, ...] = (
    *(_OWN[name] for name in ("gyro", "gravity", "joint_pos", "joint_vel", "carry_pos", "last_action")),
    Observation("clock", _clock, same(len(BOOK_PHASES) + 1), "phase of the pick-up and the share of it that is over"),
    _OWN["object_pose"],
    _OWN["object_size"],
    Observation("object_mass", lambda s: 0.5 * s.told, same(1), "mass as told, × 0.5"),
    Observation("support", lambda s: 5.0 * (s.top[:, None] - 0.6), same(1), "height of the support over 0.6 m, × 5"),
    Observation(
        "felt",
        lambda s: torch.cat([FELT_SCALE * s.felt[:, :2], s.felt[:, 2:]], dim=1),
        chain(_PLANE, _PLANE),
        "pelvis over the feet from where the carry state has it, × 10, and its rate, from encoders and tilt",
    ),
    Observation("wrists", lambda s: s.wrist, _WRISTS, "six angles of the locked wrists"),
)
KNOWN = ("last_action", "clock", "carry_pos", "object_size", "object_mass", "support", "wrists", "history")
"""Rows that no sensor measures: they are never late."""

_MORE = {row.name: row for row in seen.PRIVILEGED}
PRIVILEGED: tuple[Observation, ...] = (
    *(_MORE[n] for n in ("root_velocity", "root_height", "touch", "foot_heights", "object_velocity", "object_spin")),
    Observation("true_mass", lambda s: s.grasp.mass, same(1), "mass [kg]"),
    _MORE["time_left"],
    _MORE["torque"],
    Observation("course", lambda s: s.q - s.course_q, _JOINTS, "20 joint angles from the plan"),
    Observation("offset", lambda s: 10.0 * s.offset, _PLANE, "pelvis from the plan over the feet, × 10"),
    Observation("offset_rate", lambda s: s.rate, _PLANE, "its rate"),
    Observation(
        "object_state",
        lambda s: torch.stack([s.away * 5.0, s.turned, 5.0 * s.above.clamp(-0.2, 0.4), 0.2 * s.held_s], dim=1),
        same(4),
        "object from the carry state, its turn, its height over the support, time held",
    ),
    Observation(
        "palms",
        lambda s: 5.0 * s.to_yaw_frame(s.p_WK[:, HANDS] - s.p_WO[:, None]).flatten(1),
        swap([1, 0], VECTOR),
        "hands from the object, in Y, × 5",
    ),
)


def policy_rows(history_steps: int = 0) -> tuple[Observation, ...]:
    """Rows that the actors read, with the past where the task has it."""
    return (*POLICY, seen.past_rows(history_steps)) if history_steps else POLICY


assert len(chain(*(row.mirror for row in POLICY))[0]) == sum(len(row.mirror[0]) for row in POLICY)
