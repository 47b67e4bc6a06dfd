"""Reward terms of the pick-up: pure functions of a `PickSnapshot`, each (N,)."""

from __future__ import annotations

import torch
from torch import Tensor

from hotice.model import g1
from hotice.sim.pickup.snapshot import PickSnapshot
from hotice.sim.snapshot import HANDS
from hotice.task import rules
from hotice.task.rules import IN_CARRY_M

LIFT = 5
"""Index of the phase in which the object leaves its support."""


def follow_legs(s: PickSnapshot) -> Tensor:
    """Closeness of the legs to the plan."""
    return torch.exp(-((s.q - s.course_q)[:, g1.LOWER].square().mean(dim=1)) / 0.1**2)


def follow_arms(s: PickSnapshot) -> Tensor:
    """Closeness of the arms to the plan."""
    return torch.exp(-((s.q - s.course_q)[:, g1.UPPER].square().mean(dim=1)) / 0.1**2)


def over_feet(s: PickSnapshot) -> Tensor:
    """Closeness of the pelvis to where the plan has it over the feet."""
    return torch.exp(-(s.offset.square().sum(dim=1)) / 0.03**2)


def feet_stay(s: PickSnapshot) -> Tensor:
    """Share of feet off the floor."""
    return 1.0 - s.touch.float().mean(dim=1)


def lifted(s: PickSnapshot) -> Tensor:
    """Height of the object over its support, from the lift on: 1 from 3 cm."""
    return torch.clamp(s.above / 0.03, 0.0, 1.0) * (s.phase >= LIFT)


def in_carry(s: PickSnapshot) -> Tensor:
    """The object is in the carry state, `hotice.task.rules.in_carry`."""
    return rules.in_carry(s.away, s.turned, s.above).float()


def near_carry(s: PickSnapshot) -> Tensor:
    """Closeness of the object to its place in the carry state, once it is on its way there."""
    return torch.exp(-((s.away / IN_CARRY_M).square())) * (s.phase > LIFT)


def object_turned(s: PickSnapshot) -> Tensor:
    """Squared turn of the object from upright and straight, once it is on its way to the carry state."""
    return s.turned.square().clamp_max(1.0) * (s.phase > LIFT)


def grip_slip(s: PickSnapshot) -> Tensor:
    """Squared velocity of the object relative to the mean of the hands, from the lift on."""
    slip = (s.v_WO - s.v_WK[:, HANDS].mean(dim=1)).square().sum(dim=-1).clamp_max(4.0)
    return slip * (s.phase >= LIFT)
