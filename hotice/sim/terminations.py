"""Ends of an episode: a table of pure functions of a `Snapshot`, each (N,) bool.

Of several that hold in one step `hotice.task.rules.PRECEDENCE` decides.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from torch import Tensor

from hotice.sim.snapshot import HANDS, Snapshot
from hotice.task import rules


@dataclass(frozen=True)
class Termination:
    """A condition; `collision`: only where `TaskConfig.collisions` is on."""

    name: str
    condition: Callable[[Any], Tensor]
    collision: bool = False


def fall(s: Snapshot) -> Tensor:
    """The robot has fallen, `hotice.task.rules.fallen`."""
    return rules.fallen(s.p_WP[:, 2], -s.gravity_P[:, 2])


def drop(s: Snapshot) -> Tensor:
    """The object is dropped, `hotice.task.rules.dropped`."""
    between = s.p_WK[:, HANDS].mean(dim=1)
    return rules.dropped((s.p_WO - between).norm(dim=-1), s.p_WO[:, 2])


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
