"""The reward table: one row a term, with the agents that receive it.

Paper, section IV-B: r_low sums the sets L and S, r_up the sets U and S. Here a row's `agents` says so: L is ("low",),
U is ("up",), S is both. Weights are ours: per second, multiplied by the control period; the sum is not clipped at zero.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from hotice.errors import InvalidConfig
from hotice.sim import terms
from hotice.task.presets import LOW, UP, Agent

L, U, S = (LOW,), (UP,), (LOW, UP)


@dataclass(frozen=True)
class Reward:
    """A term with weight [1/s]; `agents`: the reward streams it enters; `source`: where the idea is from.

    term: function of the task's snapshot, (N,).
    """

    name: str
    agents: tuple[str, ...]
    weight: float
    term: Callable[[Any], Tensor]
    source: str


REWARDS: tuple[Reward, ...] = (
    # S: HOD-PF and lifting
    Reward("sgf_head", S, 0.3, terms.sgf_head, "paper IV-A, softened"),
    Reward("sgf_pelvis", S, 0.3, terms.sgf_pelvis, "paper IV-A, softened"),
    Reward("sgf_feet", S, 0.2, terms.sgf_feet, "paper IV-A, softened"),
    Reward("ogf_hands", S, 0.15, terms.ogf_hands, "paper IV-A, scaled and softened"),
    Reward("ogf_object", S, 0.25, terms.ogf_object, "paper IV-A, scaled and softened"),
    Reward("object_lift", S, 0.5, terms.object_lift, "paper IV-B"),
    Reward("clearance", S, -2.0, terms.clearance, "ours"),
    Reward("clearance_ahead", S, -1.0, terms.clearance_ahead, "ours"),
    # L: locomotion and balance
    Reward("progress", L, 5.0, terms.progress, "ours"),
    Reward("arrival", L, 2.0, terms.arrival, "paper V-A"),
    Reward("velocity_tracking", L, 2.0, terms.velocity_tracking, "CAT"),
    Reward("heading", L, 0.5, terms.heading, "ours"),
    Reward("yaw_rate", L, -0.15, terms.yaw_rate, "ours"),
    Reward("upright", L, -3.0, terms.upright, "CAT"),
    Reward("root_height", L, -8.0, terms.root_height, "CAT"),
    Reward("root_bounce", L, -0.5, terms.root_bounce, "CAT"),
    Reward("root_rocking", L, -0.08, terms.root_rocking, "CAT"),
    Reward("gait_schedule", L, 1.5, terms.gait_schedule, "CAT"),
    Reward("single_support", L, 1.0, terms.single_support, "ours"),
    Reward("flight", L, -4.0, terms.flight, "ours"),
    Reward("swing_height", L, -2.5, terms.swing_height, "CAT"),
    Reward("foot_slip", L, -0.4, terms.foot_slip, "CAT"),
    Reward("foot_spread", L, -1.0, terms.foot_spread, "ours"),
    Reward("hip_posture", L, -1.0, terms.hip_posture, "CAT"),
    Reward("stand_still", L, -0.5, terms.stand_still, "ours"),
    Reward("leg_smoothness", L, -0.03, terms.leg_smoothness, "CAT"),
    Reward("leg_torque", L, -0.08, terms.leg_torque, "CAT"),
    # U: reaching and grasp
    Reward("hand_reach", U, 1.0, terms.hand_reach, "paper IV-B"),
    Reward("grasp_slip", U, -0.5, terms.grasp_slip, "paper IV-B"),
    Reward("object_upright", U, -2.0, terms.object_upright, "paper V-A"),
    Reward("object_steady", U, -0.03, terms.object_steady, "ours"),
    Reward("arm_smoothness", U, -0.03, terms.arm_smoothness, "CAT"),
    Reward("arm_posture", U, -0.05, terms.arm_posture, "ours"),
)
TERMINATION_PENALTY = -0.5
"""Added to every stream, once, when an episode ends by a failure (ours)."""


class RewardTable:
    """Evaluates a table for a list of agents.

    Raises `InvalidConfig` for a name that occurs twice, an unknown agent, or a term that is no (N,) or not finite.
    """

    def __init__(self, rows: Sequence[Reward], agents: Sequence[Agent], dt_s: float) -> None:
        names = [r.name for r in rows]
        if len(set(names)) != len(names):
            raise InvalidConfig(f"reward name {next(n for n in names if names.count(n) > 1)!r} occurs twice")
        for row in rows:
            if not row.agents or set(row.agents) - {LOW, UP}:
                raise InvalidConfig(f"reward {row.name!r} goes to {row.agents}: known are {LOW!r} and {UP!r}")
        self.rows, self.names = tuple(rows), names
        weight = [[r.weight * dt_s * bool(set(r.agents) & set(a.receives)) for a in agents] for r in rows]
        self.weight = torch.tensor(weight)  # (R, A)

    def __call__(self, s: Any) -> tuple[Tensor, Tensor]:
        """Streams (N, A), each the weighted sum of its agent's rows, and the raw terms (N, R)."""
        values = torch.stack([row.term(s) for row in self.rows], dim=1)
        return values @ self.weight.to(values.device), values

    def check(self, s: Any) -> None:
        """Raises `InvalidConfig` unless every term is (N,) and finite on this snapshot."""
        for row in self.rows:
            value = row.term(s)
            if value.shape != s.p_WP.shape[:1] or not torch.isfinite(value).all():
                raise InvalidConfig(
                    f"reward {row.name!r} gives shape {tuple(value.shape)} or a value that is not finite"
                )
