"""Memory of the walking controller from one control step to the next."""

from __future__ import annotations

import copy
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from hotice.control.walk.dcm import DcmReference
from hotice.control.walk.footsteps import Footstep
from hotice.control.walk.swing import Swing
from hotice.control.whole_body.qp import QpMemory
from hotice.control.whole_body.solvers import Guess

Array = NDArray[np.float64]
SHIFT, SWING, DOUBLE, STAND = "shift", "swing", "double", "stand"
"""Phases: load onto the first stance foot; one foot in the air; load from foot to foot; arrived."""


@dataclass(kw_only=True)
class WalkMemory:
    """State that lasts from step to step.

    Attributes:
        phase: of `SHIFT`, `SWING`, `DOUBLE`, `STAND`; since_s: when it began; step: index of the next footstep to land.
        feet: (2, 3) where the feet stand, x, y [m], yaw [rad]; zmp: (2,) last target of the zero-moment point [m].
        reference: DCM since the last landing; omega [1/s]. swing: of the foot in the air. landing: (2,) [m], lands_s:
            as adjusted last. height_m, lean_rad: of the pelvis, as commanded last. qp: see `QpMemory`.
        footsteps: of the plan, fewer after it was told to stand; stops: whether it was.
        unadjusted: steps for which step adjustment had no answer. com (3,), dcm (2,): of the last measurement, object
            included [m].
    """

    phase: str
    since_s: float
    last_s: float
    step: int
    feet: Array
    zmp: Array
    omega: float
    reference: DcmReference
    height_m: float
    lean_rad: float
    qp: QpMemory
    swing: Swing | None = None
    landing: Array = field(default_factory=lambda: np.zeros(2))
    lands_s: float = 0.0
    footsteps: tuple[Footstep, ...] = ()
    stops: bool = False
    unadjusted: int = 0
    com: Array = field(default_factory=lambda: np.zeros(3))
    dcm: Array = field(default_factory=lambda: np.zeros(2))

    def copy(self) -> WalkMemory:
        """Independent of this one: what a step writes in place is copied, what it replaces is shared."""
        guess = Guess(x=self.qp.guess.x.copy(), y=self.qp.guess.y.copy(), z=self.qp.guess.z.copy())
        qp = replace(self.qp, guess=guess, torque=self.qp.torque.copy(), joint_pos=self.qp.joint_pos.copy())
        return replace(self, feet=self.feet.copy(), swing=copy.copy(self.swing), qp=qp)
