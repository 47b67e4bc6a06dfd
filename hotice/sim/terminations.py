"""Ends of an episode: a table of pure functions of a `Snapshot`, each (N,) bool; the first that holds counts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from torch import Tensor

from hotice.sim.snapshot import HANDS, Snapshot

OUTCOMES = ("running", "success", "fall", "drop", "robot_collision", "object_collision", "timeout", "unstable")
"""Outcome codes by position."""
FALLEN_M, UPRIGHT = 0.35, 0.5
"""Pelvis height and cosine of its lean below which the robot has fallen."""
APART_M, LOW_M = 0.15, 0.25
"""Distance from the hands' middle, and height, at which the object is dropped."""


@dataclass(frozen=True)
class Termination:
    """A condition; `collision`: only where `TaskConfig.collisions` is on."""

    name: str
    condition: Callable[[Snapshot], Tensor]
    collision: bool = False


def fall(s: Snapshot) -> Tensor:
    """Pelvis below 0.35 m or leaning by more than 60 degrees."""
    return (s.p_WP[:, 2] < FALLEN_M) | (s.gravity_P[:, 2] > -UPRIGHT)


def drop(s: Snapshot) -> Tensor:
    """Object 15 cm from where the hands hold it, or its centre below 0.25 m."""
    between = s.p_WK[:, HANDS].mean(dim=1)
    return ((s.p_WO - between).norm(dim=-1) > APART_M) | (s.p_WO[:, 2] < LOW_M)


def robot_collision(s: Snapshot) -> Tensor:
    """A link of the robot penetrates an obstacle."""
    return s.robot_hit


def object_collision(s: Snapshot) -> Tensor:
    """The object penetrates an obstacle."""
    return s.object_hit


TERMINATIONS: tuple[Termination, ...] = (
    Termination("fall", fall),
    Termination("drop", drop),
    Termination("robot_collision", robot_collision, collision=True),
    Termination("object_collision", object_collision, collision=True),
)
