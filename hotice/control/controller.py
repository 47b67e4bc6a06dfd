"""Contract of every controller: measurement and memory in, command and new memory out.

A controller itself never changes after construction: all that lasts from step to step is its memory, a dataclass that
can be deep-copied. A Drake Context can therefore hold the memory and clone it, and a replay from a copy repeats itself.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from hotice.model import g1

Array = NDArray[np.float64]
Memory = TypeVar("Memory")
NUM_JOINTS = len(g1.ACTION_JOINTS)


@dataclass(frozen=True, kw_only=True)
class Measurement:
    """Knowledge of robot and object at one instant, in W; quaternions wxyz.

    The constructor does not check: a controller answers what is not finite with a safe command and counts a fault.

    Attributes:
        time_s: since an arbitrary origin.
        joint_pos: (20,) [rad]; joint_vel: (20,) [rad/s], order `g1.ACTION_JOINTS`.
        p_WP: (3,) pelvis [m]; quat_WP: (4,); v_WP: (3,) in W [m/s]; w_WP_P: (3,) in P [rad/s].
        p_WO, quat_WO, v_WO, w_WO_O: the same of the object's centre, or None where no object is seen.
        foot_force_W: (2, 3) contact force on the left and right foot [N], or None where it is not measured.
        hand_force_W: (2, 3) contact force on the left and right hand [N], or None where it is not measured.
        stand: whether the controller is told to come to a stand: a walk ends there, a pick-up waits.
    """

    time_s: float
    joint_pos: Array
    joint_vel: Array
    p_WP: Array
    quat_WP: Array
    v_WP: Array
    w_WP_P: Array
    p_WO: Array | None = None
    quat_WO: Array | None = None
    v_WO: Array | None = None
    w_WO_O: Array | None = None
    foot_force_W: Array | None = None
    hand_force_W: Array | None = None
    stand: bool = False

    def finite(self) -> bool:
        """Whether every number that is there is finite, and every quaternion an attitude: of a length near 1."""
        known = [value for value in vars(self).values() if value is not None]
        if not all(bool(np.isfinite(value).all()) for value in known):
            return False
        return all(0.5 < q @ q < 2.0 for q in (self.quat_WP, self.quat_WO) if q is not None)


@dataclass(frozen=True, kw_only=True)
class Command:
    """Command to the joints until the next step.

    Attributes:
        torque: (20,) [N m], order `g1.ACTION_JOINTS`, within the torque limits.
        phase: name of what the controller is doing.
        faults: steps since the start that were answered with a fallback.
    """

    torque: Array
    phase: str
    faults: int


class Controller(Protocol[Memory]):
    """Steps at `rate_hz`; neither method raises for bad measurements, and neither changes what it is given."""

    @property
    def rate_hz(self) -> float:
        """Period at which `step` must be called [s]."""
        ...

    def start(self, measurement: Measurement) -> Memory:
        """Memory before the first step."""
        ...

    def step(self, memory: Memory, measurement: Measurement) -> tuple[Command, Memory]:
        """Command for the time until the next step, and the memory to pass to it."""
        ...
